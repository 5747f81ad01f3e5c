"""`upplied flights` and `looks`: logs of flown plans, what they saw and missed, and photos of a place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from upplied.cli import findings, terminal
from upplied.cli.options import AtPoint, By, FindingId, FlightId, OnlyStructure, StructureId, Texts
from upplied.cli.terminal import HERE, ID_DIGITS, PRINTED, Results, Where, errors, say
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.findings.looks import Spot

app = App(name="flights", help="Import flights of plans, compare them, and plan what they missed.")

PlanOption = Annotated[str, Parameter(help="ID of the flown plan; by default the plan that fits best.")]
_PHOTOS = "File with the times of photos, in nanoseconds of the log's clock."
PhotosOption = Annotated[Path | None, Parameter(help=_PHOTOS)]
Force = Annotated[Texts, Parameter(help="Rule to overrule: flown, whole, recorded, clearance.")]
Name = Annotated[str, Parameter(help="Name of the demonstration; by default one is generated.")]
Kind = Annotated[str, Parameter(help="Kind of the flight: flown or simulated.")]
Kinds = Annotated[str | None, Parameter(help="Kind of the flight: flown or simulated.")]
Size = Annotated[float, Parameter(help="Width of the area to show, in metres.")]


@app.command
def add(
    log: Path,
    /,
    *,
    plan: PlanOption = "",
    photos: PhotosOption = None,
    accuracy: Annotated[float | None, Parameter(help="Accuracy of the positions, in metres.")] = None,
    results: Results = PRINTED,
) -> int:
    """Import the log of a flight, align it with its plan, and store its views.

    Parameters
    ----------
    log : Path
        Log in any format that `upplied demonstrations add` reads, with its side-car file.
    """
    from upplied.fleet.flight_logs import add_flight_log, left_out

    store = results.opened()
    with errors.status("reading the log"):
        row = add_flight_log(store, log, plan, photos, accuracy_m=accuracy)
    _show(row, results)
    if not results.json and left_out(store, row):
        name = row["flight_id"][:ID_DIGITS]
        results.next_step(f"flights gap {name}", "plan a flight over the missed surface")
    return 0


@app.command(name="list")
def list_flights(*, structure: OnlyStructure = None, kind: Kinds = None, results: Results = PRINTED) -> int:
    """List the flights in the order of their import."""
    flights = results.opened().flights(structure=structure, kind=kind)
    results.show_frame("flights", flights, LABELS["flights"], ("findings", "plan", "clearance m"))
    return 0


@app.command(name="show")
def show_one(flight: FlightId, /, *, results: Results = PRINTED) -> int:
    """Show all details of one flight."""
    _show(results.opened().flight(flight), results)
    return 0


@app.command
def gap(flight: FlightId, /, *, where: Where = HERE) -> int:
    """Plan the shortest safe flight over the surface that a flight missed; the result is a draft."""
    from upplied.fleet.gaps import plan_gap

    store = where.opened()
    with errors.status("planning"):
        plan = plan_gap(store, flight)
    row = store.transfer(plan)
    first, *more = store.plan(plan).warnings
    for line in (f"{plan}: {first}", *more):
        say(line)
    say(f"{row['duration_s']:.0f} s, clearance {row['min_clearance_m']:.2f} m")
    where.next_step(f"release {plan} --by NAME", "put it in force")
    return 0


@app.command
def history(structure: StructureId, point: AtPoint, /, *, kind: Kind = "", results: Results = PRINTED) -> int:
    """Show when the patch nearest to a point was seen, from which distance and at which angle."""
    looks = results.opened().looks_at(structure, point, kind)
    title = f"views of {terminal.point_text(point)} on {structure}"
    results.show(title, terminal.rows_of(looks), ("patch", "patch_off_m"))
    if not looks["seen"].any():
        results.say("never seen")
        return 0
    last = looks[looks["seen"]].iloc[-1]
    place = f"{last['distance_m']:.1f} m at {last['incidence_deg']:.0f} degrees"
    results.say(f"last seen {last['flown_at']:%Y-%m-%d} from {place}")
    return 0


@app.command
def promote(flight: FlightId, /, *, by: By, name: Name = "", force: Force = (), where: Where = HERE) -> int:
    """Store a flight as a demonstration, to be transferred to other structures."""
    from upplied.fleet.flights import promote_flight

    outcome = promote_flight(where.opened(), flight, by, name, force)
    say(f"{outcome.demonstration_id}: a demonstration of {outcome.structure_id}")
    where.next_step("plan --dry-run", "show the resulting plans")
    return 0


def _show(row: dict[str, Any], results: Results) -> None:
    from upplied.outputs.verdicts import wind_words

    known = terminal.plain(row)
    if results.json:
        results.show("", [known])
        return
    known["wind"] = wind_words(row)
    facts = {title: known.get(name) for name, title in LABELS["flight"].items()}
    results.show_facts(f"flight {row['flight_id'][:ID_DIGITS]}", facts)


@Parameter(name="*")
@dataclass(frozen=True)
class Looks(Results):
    """The flights whose looks count, and the folder for crops of their photos."""

    out: Annotated[Path | None, Parameter(help="Folder for crops side by side, with a page.")] = None
    photos: Annotated[Path | None, Parameter(help="Folder of photos that were moved.")] = None
    simulated: Annotated[bool, Parameter(help="Include simulated flights.")] = False

    def show_looks(self, store: Catalog, title: str, spot: Spot) -> int:
        from upplied.findings.looks import FLOWN, looks_at_spot, looks_frame

        with errors.status("casting rays"):
            looks = looks_at_spot(store, spot, (*FLOWN, *["simulated"] * self.simulated))
        frame = looks_frame(looks)
        sides = frame[["left_px", "top_px", "right_px", "bottom_px"]].round(0)
        frame["box"] = [" ".join(f"{side:.0f}" for side in row) for row in sides.to_numpy()]
        self.show_frame(f"views of {title}", frame, LABELS["looks"])
        if self.out is None:
            return 0
        from upplied.findings.crops import write_crops

        structure = store.structure(spot.structure_id)
        page, missing = write_crops(self.out, title, looks, spot, structure, self.photos)
        terminal.complain_each("missing", missing)
        self.say(page)
        return int(bool(missing))


LOOKED = Looks()


@findings.app.command(name="looks")
def looks_of(finding: FindingId, /, *, results: Looks = LOOKED) -> int:
    """List every photo of every flight that shows a finding."""
    from upplied.findings.looks import off_surface, spot_of

    store = results.opened()
    row = store.finding(finding)
    spot = spot_of(row)
    sha256 = str(store.newest("structures", spot.structure_id)["sha256"])
    if spot.structure_sha256 != sha256:
        off = float(off_surface(store, [spot], sha256)[0])
        words = f"{spot.structure_id} has changed since the finding was placed"
        terminal.complain(f"{words}; the place is {off:.2f} m off its surface")
    return results.show_looks(store, f"finding {row['finding_id']}", spot)


def looks(structure: StructureId, point: AtPoint, /, *, size: Size = 0.5, results: Looks = LOOKED) -> int:
    """List every photo of every flight that shows the place of the surface nearest to a point."""
    from upplied.findings.looks import spot_at

    store = results.opened()
    title = f"{terminal.point_text(point)} of {structure}"
    return results.show_looks(store, title, spot_at(store, structure, point, size / 2))
