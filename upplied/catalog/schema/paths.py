"""The tables of steps: a demonstration as flown, and a plan, pose by pose."""

from __future__ import annotations

from upplied.catalog.schema.columns import COMMIT as _COMMIT
from upplied.catalog.schema.columns import REAL, TEXT, TRUTH, WHOLE, Column, Table
from upplied.catalog.schema.columns import identity as _id
from upplied.records.plans import ORIGINS

_POSE = (
    *(Column(f"{axis}_m", REAL, "m", f"position of the camera, {axis}, structure frame") for axis in "xyz"),
    *(
        Column(f"q{part}", REAL, "1", f"quaternion, camera to structure, {part}", low=-1, high=1)
        for part in "xyz"
    ),
    Column("qw", REAL, "1", "quaternion, camera to structure, w; never negative", low=0, high=1),
)
_ZOOM = (
    Column("hfov_deg", REAL, "deg", "full horizontal field of view, where the camera zooms", low=0, high=360),
    Column("vfov_deg", REAL, "deg", "full vertical field of view, where the camera zooms", low=0, high=180),
)

POSES = Table(
    "poses",
    "one row per step of a demonstration, as flown",
    ("demonstration_id", "commit_id", "seq"),
    (
        _id("demonstration_id", "the demonstration it belongs to"),
        Column("seq", WHOLE, "1", "0, 1, ... in the order of flight", required=True, low=0),
        Column("t_ns", WHOLE, "ns", "time stamp of the source clock", required=True),
        *_POSE,
        *_ZOOM,
        _COMMIT,
    ),
    ("commit_id", "demonstration_id", "seq"),
)

WAYPOINTS = Table(
    "waypoints",
    "one row per step of a planned trajectory",
    ("transfer_id", "commit_id", "seq"),
    (
        _id("transfer_id", "the plan it belongs to"),
        Column("seq", WHOLE, "1", "0, 1, ... in the order of flight", required=True, low=0),
        Column("t_s", REAL, "s", "time from the start", required=True, low=0),
        *_POSE,
        *_ZOOM,
        Column("is_viewpoint", TRUTH, "", "a pose chosen to see, not only to pass", required=True),
        Column(
            "origin",
            TEXT,
            "",
            "of the demonstration, or of a pass that was added to it; null before there were such passes",
            allowed=ORIGINS,
        ),
        _COMMIT,
    ),
    ("commit_id", "transfer_id", "seq"),
)
