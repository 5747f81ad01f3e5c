"""`upplied flights`: logs of flown plans, their views, and flights over the missed surface."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from upplied.cli.options import ByOption, FlightArgument, OnlyStructure, PointArgument, StructureArgument
from upplied.cli.terminal import (
    HERE,
    ID_DIGITS,
    PRINTED,
    Results,
    Where,
    errors,
    plain,
    point_text,
    rows_of,
    say,
)
from upplied.outputs.labels import LABELS

app = App(name="flights", help="Import flights of plans, compare them, and plan what they missed.")

PlanOption = Annotated[str, Parameter(help="ID of the flown plan; by default the plan that fits best.")]
PhotosOption = Annotated[
    Path | None, Parameter(help="File with the times of photos, in nanoseconds of the log's clock.")
]
ForceOption = Annotated[
    tuple[str, ...], Parameter(help="Rule to overrule: flown, whole, recorded, clearance.")
]


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
def list_flights(
    *,
    structure: OnlyStructure = None,
    kind: Annotated[str | None, Parameter(help="Kind of the flight: flown or simulated.")] = None,
    results: Results = PRINTED,
) -> int:
    """List the flights in the order of their import."""
    flights = results.opened().flights(structure=structure, kind=kind)
    results.show_frame("flights", flights, LABELS["flights"], ("findings", "plan", "clearance m"))
    return 0


@app.command(name="show")
def show_one(flight: FlightArgument, /, *, results: Results = PRINTED) -> int:
    """Show all details of one flight."""
    _show(results.opened().flight(flight), results)
    return 0


@app.command
def gap(flight: FlightArgument, /, *, where: Where = HERE) -> int:
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
def history(
    structure: StructureArgument,
    point: PointArgument,
    /,
    *,
    kind: Annotated[str, Parameter(help="Kind of the flight: flown or simulated.")] = "",
    results: Results = PRINTED,
) -> int:
    """Show when the patch nearest to a point was seen, from which distance and at which angle."""
    looks = results.opened().looks_at(structure, point, kind)
    results.show(f"views of {point_text(point)} on {structure}", rows_of(looks), ("patch", "patch_off_m"))
    seen = looks[looks["seen"]]
    if seen.empty:
        results.say("never seen")
        return 0
    last = seen.iloc[-1]
    place = f"{last['distance_m']:.1f} m at {last['incidence_deg']:.0f} degrees"
    results.say(f"last seen {last['flown_at']:%Y-%m-%d} from {place}")
    return 0


@app.command
def promote(
    flight: FlightArgument,
    /,
    *,
    by: ByOption,
    name: Annotated[str, Parameter(help="Name of the demonstration; by default one is generated.")] = "",
    force: ForceOption = (),
    where: Where = HERE,
) -> int:
    """Store a flight as a demonstration, to be transferred to other structures."""
    from upplied.fleet.promoting import promote_flight

    outcome = promote_flight(where.opened(), flight, by, name, force)
    say(f"{outcome.demonstration_id}: a demonstration of {outcome.structure_id}")
    where.next_step("plan --dry-run", "show the resulting plans")
    return 0


def _show(row: dict[str, Any], results: Results) -> None:
    from upplied.outputs.verdicts import wind_words

    known = plain(row)
    if results.json:
        results.show("", [known])
        return
    known["wind"] = wind_words(row)
    facts = {title: known.get(name) for name, title in LABELS["flight"].items()}
    results.show_facts(f"flight {row['flight_id'][:ID_DIGITS]}", facts)
