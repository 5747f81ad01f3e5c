"""6. Other settings.

A wider clearance, a slower vehicle, and what both do to the plan.
"""

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
flight = fly(cube, "sides", seed=1)

for changes in ({}, {"route": {"clearance_m": 4.0}}, {"retime": {"max_speed_mps": 1.0}}):
    plan = plan_transfer(flight, cube, cuboid, settings_for("recommended", **changes))
    measures = plan.measures
    print(
        f"{changes or 'as recommended'}: {plan.status}, clearance {measures.min_clearance_m:.2f} m, "
        f"{measures.duration_s:.0f} s, seen {measures.coverage_seen_pct:.1f} %"
    )
