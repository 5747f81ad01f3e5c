"""4. Mission files.

One plan for QGroundControl and for a map, split into sorties that a battery lasts for.
"""

from upplied.config import settings_for
from upplied.outputs.missions import MissionOptions, export
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
flight = fly(cube, "sides", seed=1)
plan = plan_transfer(flight, cube, cuboid, settings_for("recommended"))

options = MissionOptions(altitude="relative", endurance_s=110.0, reserve_pct=25.0)
for format, name in (("qgc-plan", "cuboid.plan"), ("geojson", "cuboid.geojson"), ("mcap", "cuboid.mcap")):
    written = export(plan, cuboid, format, name, options, flight.camera)
    print(format, [path.name for path in written.paths])
    for note in written.notes:
        print("  ", note)
