"""5. The plan flown in wind.

A point mass with a position controller, gusts and a drifting position estimate; then the same measures.
"""

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.simulate import Wind, fly_trajectory, measure_flown

cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
flight, settings = fly(cube, "sides", seed=1), settings_for("recommended")
plan = plan_transfer(flight, cube, cuboid, settings)

for speed in (0.0, 4.0, 8.0):
    air = fly_trajectory(plan.trajectory, wind=Wind(speed_mps=speed, gusts=speed > 0), seed=0)
    flown = measure_flown(air, plan, flight, cube, cuboid, settings)
    print(
        f"wind {speed:.0f} m/s: clearance {flown.measures.min_clearance_m:.2f} m "
        f"(planned {plan.measures.min_clearance_m:.2f}), seen {flown.measures.coverage_seen_pct:.1f} %"
    )
