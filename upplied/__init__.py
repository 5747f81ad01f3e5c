"""Plan the inspection of every structure of a kind from one expert's flight."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog, open_catalog
    from upplied.config import Settings, settings_for
    from upplied.errors import UppliedError
    from upplied.inputs.logs import read_demonstration
    from upplied.inputs.manifests import read_manifest
    from upplied.inputs.meshes import read_structure
    from upplied.outputs.missions import MissionOptions, export
    from upplied.planning.plan import plan_transfer
    from upplied.records import (
        Camera,
        Cloud,
        Correspondences,
        Demonstration,
        Measures,
        Placement,
        Plan,
        Registration,
        Structure,
        Surroundings,
        Trajectory,
    )

__version__ = "0.2.0"

# Loaded when first asked for, so that `import upplied` and the command's help stay fast.
_PUBLIC = {
    # The database: what was flown and planned.
    "Catalog": "upplied.catalog.database",
    "open_catalog": "upplied.catalog.database",
    # The nouns.
    "Camera": "upplied.records",
    "Cloud": "upplied.records",
    "Correspondences": "upplied.records",
    "Demonstration": "upplied.records",
    "Measures": "upplied.records",
    "Placement": "upplied.records",
    "Plan": "upplied.records",
    "Registration": "upplied.records",
    "Structure": "upplied.records",
    "Surroundings": "upplied.records",
    "Trajectory": "upplied.records",
    # Files to records, records to a plan, a plan to a mission.
    "read_demonstration": "upplied.inputs.logs",
    "read_manifest": "upplied.inputs.manifests",
    "read_structure": "upplied.inputs.meshes",
    "Settings": "upplied.config",
    "settings_for": "upplied.config",
    "plan_transfer": "upplied.planning.plan",
    "MissionOptions": "upplied.outputs.missions",
    "export": "upplied.outputs.missions",
    # The base of every error that is raised on purpose.
    "UppliedError": "upplied.errors",
}

__all__ = [
    "Camera",
    "Catalog",
    "Cloud",
    "Correspondences",
    "Demonstration",
    "Measures",
    "MissionOptions",
    "Placement",
    "Plan",
    "Registration",
    "Settings",
    "Structure",
    "Surroundings",
    "Trajectory",
    "UppliedError",
    "__version__",
    "export",
    "open_catalog",
    "plan_transfer",
    "read_demonstration",
    "read_manifest",
    "read_structure",
    "settings_for",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
