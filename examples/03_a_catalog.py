"""3. A catalog that remembers.

Structures, demonstrations and plans are kept with their history; what exists is not planned again.
"""

import upplied
from upplied import fleet
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
catalog = upplied.open_catalog("catalog")
catalog.add_structures([cube, cuboid])
catalog.add_demonstrations([fly(cube, "sides", seed=1)])

request = fleet.PlanRequest(presets=("recommended", "baseline"))
decision = fleet.decide(catalog, request)
print(fleet.transfer(catalog, decision.jobs, run_id="by hand", resources=fleet.Resources(workers=1)))
again = fleet.decide(catalog, request)
print(f"a second run would plan {len(again.jobs)}; {again.unchanged} are unchanged")

plans = catalog.transfers(status="ok")
print(plans.groupby("preset")[["coverage_seen_pct", "min_clearance_m"]].mean().round(2))
flyable = plans[plans["preset"] == "recommended"]  # the others are for comparison, and not given out
path = catalog.trajectory(flyable["transfer_id"].iloc[-1])
print("after five seconds the camera is at", path.at(5.0).positions.round(2))
