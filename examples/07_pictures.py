"""7. Pictures without a display.

A structure with its flight, and a transfer; PNGs drawn by casting rays.
"""

from pathlib import Path

from upplied.config import settings_for
from upplied.outputs import figures
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
flight = fly(cube, "sides", seed=1)
plan = plan_transfer(flight, cube, cuboid, settings_for("recommended"))

path = ("demonstrated path", flight, "#d55e00")
Path("cube.png").write_bytes(figures.structure_png(cube, ["three-quarter"], trajectories=[path], width=600))
Path("transfer.png").write_bytes(figures.transfer_png(cube, cuboid, flight, plan, width=800))
