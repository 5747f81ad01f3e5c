"""A catalog with one plan on a cube, for tests of what people open."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.geometry.poses import interpolate
from upplied.records import Plan
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CUBE = member("cube-v1").structure
FLOWN = fly(CUBE, "sides", seed=1)
PATH = interpolate(FLOWN.trajectory, np.arange(0.0, 60.0, 0.5))
PLAN = Plan(FLOWN.demonstration_id, "cube-v1", "cube-v1", CUBE.kind, "recommended", "ok", trajectory=PATH,
            is_viewpoint=np.arange(len(PATH)) % 10 == 0, flyable=True)  # fmt: skip
KEY = hashlib.sha256(b"plan").hexdigest()


def catalog_with_plan(folder: Path) -> Catalog:
    """A new catalog in a folder, with the cube, its demonstration and a plan."""
    catalog = open_catalog(folder / "catalog")
    catalog.add_structures([CUBE])
    catalog.add_demonstrations([FLOWN])
    catalog.add_plans([(KEY, PLAN, {})])
    return catalog
