"""`upplied fly`: a plan flown in simulated wind, planned against flown."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from upplied.cli.options import PlanArgument
from upplied.cli.terminal import PRINTED, Results, compared, errors
from upplied.outputs.labels import LABELS

TowardsOption = Annotated[
    float, Parameter(help="Direction of the wind, in degrees counter-clockwise from +X.")
]


def fly(
    transfer: PlanArgument,
    /,
    *,
    wind: Annotated[float, Parameter(help="Mean wind speed, in m/s.")] = 5.0,
    towards: TowardsOption = 60.0,
    gusts: Annotated[bool, Parameter(negative="--no-gusts", help="Add gusts.")] = True,
    seed: Annotated[int, Parameter(help="Random seed of gusts and errors.")] = 0,
    force: Annotated[tuple[str, ...], Parameter(help="Safety rule to overrule, by name.")] = (),
    results: Results = PRINTED,
) -> int:
    """Simulate a plan in wind and show its margin; the next report includes the result.

    Exit code 1 if the flight comes nearer to the structure than the clearance limit.
    """
    from upplied.catalog.verbs.recipes import settings_of
    from upplied.fleet.flights import fly_plan
    from upplied.simulate import Wind

    store, transfer = results.plan(transfer)
    with errors.status("flying"):
        flown = fly_plan(store, transfer, Wind(wind, towards, gusts), seed, force)
    row = store.transfer(transfer)
    route = settings_of(row["settings_json"]).route
    rows = compared(LABELS["simulated"], {"planned": row, "flown": flown}, ("change", "flown", "planned"))
    results.show(f"{transfer} in {wind:g} m/s of wind", rows)
    if not route.enforce:
        return 0
    margin = flown["min_clearance_m"] - route.clearance_m
    results.say(f"margin above the limit of {route.clearance_m:g} m: {margin:+.2f} m")
    if margin < 0:
        errors.print(
            "Too little clearance in this wind: plan with a larger --clearance, or fly in less wind."
        )
    else:
        results.next_step(f"export {transfer} --to qgc-plan --output mission.plan", "write the mission file")
    return int(margin < 0)
