"""1. One demonstration, one target, one plan.

No files and no catalog: records in, a record out.
"""

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
flight = fly(cube, "sides", seed=1)

plan = plan_transfer(flight, cube, cuboid, settings_for("recommended"))
assert plan.status == "ok", plan.reason

measures = plan.measures
print(f"{len(plan.trajectory)} waypoints, {plan.trajectory.t_s[-1]:.0f} s")
print(
    f"really seen {measures.coverage_seen_pct:.1f} % of {measures.coverage_attainable_pct:.1f} % attainable"
)
print(f"least clearance {measures.min_clearance_m:.2f} m")
