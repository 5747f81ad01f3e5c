"""`upplied flights`: what was really flown, what it saw, and the flight that shows what it left out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from upplied.cli.options import ByOption, CatalogOption, FlightArgument, JsonOption
from upplied.cli.terminal import (
    ID_DIGITS,
    console,
    errors,
    next_step,
    opened,
    plain,
    rows_of,
    say,
    show,
    show_frame,
)

app = App(name="flights", help="Import flights of plans, compare them, and plan what they missed.")

LISTED = {
    "flight_id": "flight",
    "kind": "kind",
    "target_id": "target",
    "transfer_id": "plan",
    "flown_at": "flown",
    "flown_pct": "of plan %",
    "inspected_pct": "inspected %",
    "inspected_if_corrected_pct": "if corrected %",
    "required_pct": "in view %",
    "min_clearance_m": "clear m",
    "findings": "findings",
}
SHOWN = {
    "kind": "kind",
    "flown_at": "flown",
    "operator": "operator",
    "transfer_id": "plan",
    "target_id": "target",
    "flown_pct": "share of the plan's length flown, %",
    "inspected_pct": "share of the planned surface inspected as planned, %",
    "inspected_if_corrected_pct": "the same if the alignment is right, %",
    "required_pct": "share of the planned surface certainly in view, %",
    "assumed_pct": "additional share in view if the alignment is right, %",
    "min_clearance_m": "minimum clearance, m",
    "silent_s": "clearance not known for, s",
    "cross_track_p95_m": "deviation from the planned path, 95th percentile, m",
    "plan_frechet_m": "Frechet distance from the flown part of the plan, m",
    "duration_s": "duration, s",
    "photos": "photos",
    "photos_missing": "viewpoints whose photo is missing",
    "clock_s": "start of the plan in the log, s",
    "clock_error_s": "standard error of that start, s",
    "shift_m": "shift of the log, m",
    "turn_deg": "rotation of the log, deg",
    "place_error_m": "position error, m",
    "camera_yaw_deg": "rotation of the logged camera, deg",
    "wind": "wind",
    "findings": "findings",
}


@app.command
def add(
    log: Path,
    /,
    *,
    plan: Annotated[
        str, Parameter(help="ID of the plan that was flown; by default the plan that fits best.")
    ] = "",
    photos: Annotated[
        Path | None, Parameter(help="Times of the photos, in nanoseconds of the log's clock.")
    ] = None,
    accuracy: Annotated[float | None, Parameter(help="Accuracy of the positions, in metres.")] = None,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Import the log of a flight, align it with its plan, and store what it showed.

    Parameters
    ----------
    log : Path
        Any log that demonstrations are read from; with its side-car.
    """
    from upplied.fleet.flight_logs import add_flight_log, left_out

    store = opened(catalog)
    with errors.status("reading the log"):
        row = add_flight_log(store, log, plan, photos, accuracy_m=accuracy)
    _tell(row, json)
    if not json and left_out(store, row):
        name = row["flight_id"][:ID_DIGITS]
        next_step(f"flights gap {name}", "plan a flight over the missed surface", catalog)
    return 0


@app.command(name="list")
def list_flights(
    *,
    structure: Annotated[str | None, Parameter(help="Only flights of this structure.")] = None,
    kind: Annotated[str | None, Parameter(help="flown or simulated.")] = None,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """List the flights in the order of their import."""
    flights = opened(catalog).flights(structure=structure, kind=kind)
    show_frame("flights", flights, LISTED, json, ("findings", "plan", "clear m"))
    return 0


@app.command(name="show")
def show_one(
    flight: FlightArgument, /, *, catalog: CatalogOption = "catalog", json: JsonOption = False
) -> int:
    """Show all details of one flight."""
    _tell(opened(catalog).flight(flight), json)
    return 0


@app.command
def gap(flight: FlightArgument, /, *, catalog: CatalogOption = "catalog") -> int:
    """Plan the shortest safe flight over the surface that a flight missed; the result is a draft."""
    from upplied.fleet.gaps import plan_gap

    store = opened(catalog)
    with errors.status("planning"):
        plan = plan_gap(store, flight)
    row = store.transfer(plan)
    first, *more = store.plan(plan).warnings
    for line in (f"{plan}: {first}", *more):
        say(line)
    console.print(f"{row['duration_s']:.0f} s, clearance {row['min_clearance_m']:.2f} m")
    next_step(f"release {plan} --by NAME", "put it in force", catalog)
    return 0


@app.command
def history(
    structure: str,
    x: float,
    y: float,
    z: float,
    /,
    *,
    kind: Annotated[str, Parameter(help="flown or simulated.")] = "",
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Show when the patch nearest to a point was seen, from which distance and at which angle.

    Parameters
    ----------
    x, y, z : float
        Point in the frame of the structure, m.
    """
    looks = opened(catalog).looks_at(structure, (x, y, z), kind)
    show(f"looks at ({x:g}, {y:g}, {z:g}) m of {structure}", rows_of(looks), json, ("patch", "patch_off_m"))
    seen = looks[looks["seen"]]
    if not json:
        last = None if seen.empty else seen.iloc[-1]
        where = "" if last is None else f"{last['distance_m']:.1f} m at {last['incidence_deg']:.0f} degrees"
        console.print("never seen" if last is None else f"last seen {last['flown_at']:%Y-%m-%d} from {where}")
    return 0


@app.command
def promote(
    flight: FlightArgument,
    /,
    *,
    by: ByOption,
    name: Annotated[str, Parameter(help="Name of the demonstration; by default one is generated.")] = "",
    force: Annotated[
        tuple[str, ...], Parameter(help="Rule to overrule: flown, whole, recorded or clearance.")
    ] = (),
    catalog: CatalogOption = "catalog",
) -> int:
    """Store a flight as a demonstration, to be transferred to other structures."""
    from upplied.fleet.promoting import promote_flight

    outcome = promote_flight(opened(catalog), flight, by, name, force)
    console.print(f"{outcome.demonstration_id}: a demonstration of {outcome.structure_id}", markup=False)
    next_step("plan --dry-run", "show the resulting plans", catalog)
    return 0


def _tell(row: dict[str, Any], json: bool) -> None:
    from upplied.outputs.flown import wind_words

    known = plain(row)
    if json:
        show("", [known], json)
        return
    known["wind"] = wind_words(row)
    facts = [{"what": title, "value": known.get(name)} for name, title in SHOWN.items()]
    show(
        f"flight {row['flight_id'][:ID_DIGITS]}", [each for each in facts if each["value"] not in (None, "")]
    )
