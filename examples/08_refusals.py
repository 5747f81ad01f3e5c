"""8. Refusals.

What fits badly is not planned, and the reason is said in words.
"""

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

cube, bridge = member("cube-v1").structure, member("bridge-1-v1").structure
flight = fly(cube, "sides", seed=1)

plan = plan_transfer(flight, cube, bridge, settings_for("recommended"))
assert plan.status == "refused" and plan.trajectory is None
print(plan.reason)
