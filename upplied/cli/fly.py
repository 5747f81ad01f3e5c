"""`upplied fly`: a plan flown in simulated wind, planned against flown."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import App, Parameter

from upplied.cli.options import CatalogOption, JsonOption, PlanArgument
from upplied.cli.terminal import console, errors, next_step, number, opened_at, show

app = App(name="fly", help="Simulate a plan in wind and show its margin.")

MEASURED = {
    "min_clearance_m": "minimum clearance, m",
    "coverage_inspected_pct": "inspected surface shown, %",
    "coverage_seen_pct": "surface seen, %",
    "coverage_paper_pct": "seen by frustum, %",
    "duration_s": "duration, s",
    "peak_speed_mps": "peak speed, m/s",
}


@app.default
def fly(
    transfer: PlanArgument,
    /,
    *,
    wind: Annotated[float, Parameter(help="Mean wind speed, in m/s.")] = 5.0,
    towards: Annotated[
        float, Parameter(help="Direction of the wind, in degrees counter-clockwise from +X.")
    ] = 60.0,
    gusts: Annotated[bool, Parameter(negative="--no-gusts", help="Add gusts.")] = True,
    seed: Annotated[int, Parameter(help="Random seed of gusts and errors.")] = 0,
    force: Annotated[tuple[str, ...], Parameter(help="Safety rule to overrule, by name.")] = (),
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Simulate a plan and compare; the next report includes the result.

    Exit code 1 if the flight comes nearer to the structure than the clearance limit.
    """
    from upplied.catalog.verbs.recipes import settings_of
    from upplied.fleet.flights import fly_plan
    from upplied.simulate import Wind

    store, transfer = opened_at(catalog, transfer)
    with errors.status("flying"):
        flown = fly_plan(store, transfer, Wind(wind, towards, gusts), seed, force)
    row = store.transfer(transfer)
    route = settings_of(row["settings_json"]).route
    show(f"{transfer} in {wind:g} m/s of wind", _compared(flown, row), json)
    if not route.enforce:
        return 0
    margin = flown["min_clearance_m"] - route.clearance_m
    if not json:
        console.print(f"margin above the limit of {route.clearance_m:g} m: {margin:+.2f} m")
    if margin < 0:
        errors.print(
            "Too little clearance in this wind: plan with a larger --clearance, or fly in less wind."
        )
    elif not json:
        next_step(f"export {transfer} --to qgc-plan --output mission.plan", "write the mission file", catalog)
    return int(margin < 0)


def _compared(flown: dict[str, Any], row: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for name, title in MEASURED.items():
        planned, measured = number(row[name]), number(flown[name])
        change = None if planned is None or measured is None else measured - planned
        rows.append({"measure": title, "planned": planned, "flown": measured, "change": change})
    return rows
