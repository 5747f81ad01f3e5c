"""`upplied findings` and `reshoot`: findings, their photos, and the same place on other structures."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from upplied.cli.options import FindingId, OnlyKind, OnlyStructure, Point
from upplied.cli.terminal import HERE, PRINTED, Results, Where, complain_each, errors, say
from upplied.errors import SettingsError
from upplied.outputs.labels import LABELS

_HELP = "Place findings on structures, see them again, and find the same place elsewhere."
app = App(name="findings", help=_HELP)
LISTED = LABELS["findings"]
State = Literal["open", "watched", "repaired", "dismissed"]
SPARE = ("note", "severity", "by")
By = Annotated[str, Parameter(help="Your name, stored with the finding.")]
Note = Annotated[str, Parameter(help="Note, stored with the finding.")]
PhotoOption = Annotated[str, Parameter(help="Name or path of a registered photo.")]
TimeOption = Annotated[float | None, Parameter(help="Seconds from its first pose, in place of a photo.")]
PixelOption = Annotated[tuple[float, float] | None, Parameter(help="X and Y in pixels from the upper left.")]
BoxOption = Annotated[tuple[float, float, float, float] | None, Parameter(help="X Y WIDTH HEIGHT in pixels.")]
AtOption = Annotated[Point | None, Parameter(help="X Y Z in metres, in the structure's frame.")]
_POSE_ERROR = "Position error in metres (95 %); by default the flight's."
PoseErrorOption = Annotated[float | None, Parameter(help=_POSE_ERROR)]
_OF_MARKS = "ID of the flight or demonstration of the marks that name none."
Times = Annotated[Path | None, Parameter(help="CSV with name and t_ns, or t_s from the first pose.")]
Clock = Annotated[float, Parameter(help="Seconds that the camera's clock is behind the log's.")]
Selected = Annotated[str, Parameter(help="IDs separated by commas, or a state such as open.")]
Target = Annotated[str, Parameter(help="Structure to plan the mission for.")]
_REFERENCE = "Structure on which all places are shown: one map for a kind."
Fineness = Annotated[float, Parameter("--mm-px", help="Largest pixel on the surface, in mm.")]
Since = Annotated[str | None, Parameter("--since", help="First date of looks, such as 2026-03-01.")]
To = Annotated[str, Parameter("--to", help="IDs separated by commas, or `kind` for all of its kind.")]


@app.command
def add(
    file: Path | None = None,
    /,
    *,
    by: By,
    photo: PhotoOption = "",
    flight: Annotated[str, Parameter(help=_OF_MARKS)] = "",
    time: TimeOption = None,
    pixel: PixelOption = None,
    box: BoxOption = None,
    outline: Annotated[str, Parameter(help='Corners in order, in pixels: "X Y X Y X Y".')] = "",
    structure: Annotated[str, Parameter(help="Structure of the point in --at.")] = "",
    at: AtOption = None,
    class_name: Annotated[str, Parameter("--class", help="Class, such as corrosion.")] = "",
    severity: Annotated[str, Parameter(help="Severity, such as minor or critical.")] = "",
    note: Note = "",
    pose_error: PoseErrorOption = None,
    attitude_error: Annotated[float, Parameter(help="Attitude error in degrees (one sigma).")] = 0.4,
    pixel_error: Annotated[float, Parameter(help="Error of the mark in pixels (one sigma).")] = 1.0,
    results: Results = PRINTED,
) -> int:
    """Place one mark, or the marks of a file, on their structures.

    Parameters
    ----------
    file : Path, optional
        Detections: COCO JSON, CSV or GeoJSON. Without it the options state one mark.
    """
    from upplied.findings.adding import add_marks
    from upplied.findings.marks import Mark, box_corners, corners_of, read_marks
    from upplied.findings.place import Errors

    stated = [value is not None and value != "" for value in (pixel, box, outline, at)]
    if (file is None) != (sum(stated) == 1):
        rule = "one of FILE, --pixel, --box, --outline, --at"
        raise SettingsError("a finding", "has no mark, or several", rule)
    if file is not None:
        marks = [replace(mark, flight=mark.flight or flight) for mark in read_marks(file)]
    else:
        try:
            corners = corners_of(outline.split()) if outline else ()
            pixels = (pixel,) if pixel else box_corners(*box) if box else corners
        except ValueError as error:
            raise SettingsError("the mark", f"cannot be read: {error}", "numbers of pixels") from None
        about = {"class_name": class_name, "severity": severity, "note": note, "t_s": time, "flight": flight}
        marks = [Mark("the finding", photo, pixels, at, structure, **about)]  # type: ignore[arg-type]
    if min(pose_error or 0.0, attitude_error, pixel_error) < 0:
        raise SettingsError("an error", "is below 0", "0 or more")
    kinds_of_error = Errors(attitude_deg=attitude_error, pixel_px=pixel_error)
    with errors.status("casting rays"):
        marks_added = add_marks(results.opened(), marks, by, kinds_of_error, pose_error)
    complain_each("refused", marks_added.refused)
    rows = results.opened().findings()
    if marks_added.ids or results.json:
        results.show_frame("findings", rows[rows["finding_id"].isin(set(marks_added.ids))], LISTED, SPARE)
    known = len(marks_added.ids) - marks_added.new
    results.say(f"{marks_added.new} added, {known} already known, {len(marks_added.refused)} refused")
    if marks_added.ids:
        results.next_step(f"findings looks {marks_added.ids[-1]}", "every photo that shows it")
    return int(bool(marks_added.refused))


@app.command
def photos(
    flight: str, folder: Path, /, *, times: Times = None, clock: Clock = 0.0, by: By = "", where: Where = HERE
) -> int:
    """Register the photos of a flight by name, hash and time; they stay where they are.

    Parameters
    ----------
    flight : str
        ID of the flight, or its beginning, or of a demonstration.
    """
    from upplied.findings.photos import flight_of, register_photos

    store = where.opened()
    with errors.status("reading photos"):
        new, refused = register_photos(store, flight_of(store, flight), folder, times, clock, by)
    complain_each("refused", refused)
    say(f"{new} photos registered, {len(refused)} refused")
    return int(bool(refused))


@app.command(name="list")
def list_findings(
    *,
    structure: OnlyStructure = None,
    kind: OnlyKind = None,
    state: Annotated[State | None, Parameter(help="Only findings in this state.")] = None,
    class_name: Annotated[str | None, Parameter("--class", help="Only findings of this class.")] = None,
    reference: Annotated[str, Parameter(help=_REFERENCE)] = "",
    out: Annotated[Path | None, Parameter(help="Folder for a page with that map in 3-D.")] = None,
    results: Results = PRINTED,
) -> int:
    """List the findings in their current state."""
    store = results.opened()
    if out is not None and not reference:
        raise SettingsError("--out", "has no structure to show findings on", "", "add --reference STRUCTURE")
    if not reference:
        rows = store.findings(structure=structure, kind=kind, state=state, class_name=class_name)
        results.show_frame("findings", rows, LISTED, SPARE)
        return 0
    from upplied.findings.carried import Carrying
    from upplied.findings.queries import by_reference

    with errors.status("carrying") as status:
        carrying = Carrying(store, status.update)
        rows = by_reference(store, reference, class_name=class_name, state=state, carrying=carrying)
    mapped = {f"reference_{name}": name for name in ("x_m", "y_m", "z_m", "probability", "doubtful")}
    keys = ("finding_id", "target_id", "class", "state")
    results.show_frame(f"findings on {reference}", rows, {key: LISTED[key] for key in keys} | mapped)
    if out is not None:
        from upplied.outputs.site import write_findings_page

        results.say(write_findings_page(store, reference, rows, out))
    return 0


@app.command(name="set")
def set_state(finding: FindingId, state: State, /, *, by: By, note: Note = "", where: Where = HERE) -> int:
    """Change the state of a finding; its history stays."""
    row = where.opened().set_finding(finding, state, by, note)
    say(f"finding {row['finding_id']} is {state}")
    return 0


@app.command
def history(finding: str, /, *, results: Results = PRINTED) -> int:
    """Show the states of a finding, who changed them and why."""
    store = results.opened()
    name = store.finding(finding)["finding_id"]
    rows = store.findings(history=True)
    columns = {"added_at": "when", "state": "state", "by": "by", "note": "note"}
    results.show_frame(f"finding {name}", rows[rows["finding_id"] == name], columns, SPARE)
    return 0


@app.command
def carry(
    finding: FindingId,
    /,
    *,
    to: To = "kind",
    every: Annotated[bool, Parameter(help="Repeat on each similar part, such as each blade.")] = False,
    mm_px: Fineness = float("inf"),
    since: Since = None,
    results: Results = PRINTED,
) -> int:
    """Show the same place on other structures, and when it was last seen there."""
    from upplied.findings.carried import Carrying
    from upplied.findings.queries import photographed

    store = results.opened()
    row = store.finding(finding)
    with errors.status("carrying") as status:
        carrying = Carrying(store, status.update)
        spots = photographed(store, row, to, mm_px, since, every=every, carrying=carrying)
    results.show_frame(f"finding {row['finding_id']} elsewhere", spots, LABELS["carried"], SPARE)
    for name, part, doubt in spots.loc[spots["doubt"] != "", ["structure_id", "part", "doubt"]].to_numpy():
        results.say(f"{name}, part {part}: {doubt}")
    return 0


def reshoot(*, findings: Selected, on: Target, mm_px: Fineness, where: Where = HERE) -> int:
    """Plan a mission that shows findings from where their photos did; the result is a draft."""
    from upplied.findings.campaign import selected_findings
    from upplied.findings.reshoot import plan_reshoot

    store = where.opened()
    with errors.status("planning"):
        plan = plan_reshoot(store, selected_findings(store, findings, on), on, mm_px)
    for words in plan.words:
        say(words)
    say(f"{plan.transfer_id}: a draft for {on}")
    where.next_step(f"release {plan.transfer_id} --by NAME", "put it in force")
    return int(bool(plan.refused))


@app.command
def campaign(
    finding: FindingId, /, *, mm_px: Fineness, to: To = "kind", since: Since = None, where: Where = HERE
) -> int:
    """Plan a draft for each structure where no flight showed the place of a finding."""
    from upplied.findings.campaign import plan_campaign

    store = where.opened()
    with errors.status("planning"):
        plans = plan_campaign(store, store.finding(finding), mm_px, to, since)
    for one in plans:
        say(f"{one['structure_id']}: {one['status']}{': ' if one['words'] else ''}{one['words']}")
    return int(any(one["status"] == "refused" for one in plans))
