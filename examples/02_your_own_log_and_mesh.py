"""2. Your own mesh and log.

Any mesh of trimesh's formats with a manifest, and poses written as an MCAP log. The same readers take the log
of a real recorder, see the how-to.
"""

from pathlib import Path

import numpy as np
import trimesh

from upplied.geometry.poses import from_yaw_pitch
from upplied.inputs.logs import read_demonstration
from upplied.inputs.manifests import read_manifest
from upplied.inputs.meshes import read_structure
from upplied.outputs.logs import write_log
from upplied.records import Camera, Demonstration

# A tank, 8 m across and 10 m high, modelled in centimetres.
tank = trimesh.creation.cylinder(radius=400.0, height=1000.0, sections=64)
tank.apply_translation([0.0, 0.0, 500.0])
tank.export("tank.stl")
Path("structures.toml").write_text(
    """
[[structure]]
id = "tank-1"
kind = "tank"
path = "tank.stl"
units = "cm"
up = "z"
symmetric = true   # no heading can be told from the shape
ground_z = 0.0
"""
)
structure = read_structure(read_manifest("structures.toml")[0])
print(structure)

# Once round it at 9 m from the axis, the camera turned to the wall.
angle = np.linspace(0.0, 2.0 * np.pi, 600)
height = np.linspace(3.0, 9.0, 600)
flight = Demonstration(
    demonstration_id="round-the-tank",
    structure_id="tank-1",
    t_ns=1_767_600_000_000_000_000 + np.arange(600) * 100_000_000,
    positions=np.column_stack([9.0 * np.cos(angle), 9.0 * np.sin(angle), height]),
    quat_xyzw=from_yaw_pitch(angle + np.pi, np.zeros(600)),
    camera=Camera(),
)
write_log("round-the-tank.mcap", flight, structure)
read = read_demonstration("round-the-tank.mcap")
print(f"{read.demonstration_id}: {len(read)} poses of {read.topic}, clock {read.clock}")
assert np.abs(read.positions - flight.positions).max() < 1e-6
