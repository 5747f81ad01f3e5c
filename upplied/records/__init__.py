# ruff: noqa: F401
"""The nouns of the method: frozen records of arrays, with shape, unit and frame at each field.

Frames. Everything is in metres in the *structure frame*: Z up, +X forward (nose, bow, rotor hub,
long axis). A camera pose is a position and a quaternion ``x y z w`` that turns the camera frame
(x forward along the optical axis, y left, z up) into the structure frame. See CONVENTIONS.md.
"""

from upplied.records.base import Bools, Floats, Ints, Record, Rows
from upplied.records.flights import Camera, Demonstration, Lens, Trajectory
from upplied.records.planning import (
    Cloud,
    Correspondences,
    Displacement,
    Registration,
    Viewpoints,
    Visibility,
    Waypoints,
)
from upplied.records.plans import (
    SURFACE_STATES,
    Counterpart,
    Measures,
    Photos,
    Plan,
    RequiredSurface,
    SupposedSurface,
    SurfaceStates,
)
from upplied.records.structures import Frame, Placement, Structure, StructureInFrame, Surroundings
