"""Plans once with each preset: what is compiled for that is kept for every process of the tests."""

from __future__ import annotations

from upplied.config import PRESETS, settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

if __name__ == "__main__":
    cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
    flight = fly(cube, "sides")
    for preset in PRESETS:
        plan_transfer(flight, cube, cuboid, settings_for(preset))
