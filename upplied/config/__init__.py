"""Settings: one frozen class per stage, each default in one place, and the presets.

``paper`` is the method as published; ``recommended`` is for flying; ``baseline``
is the paper's peer, the demonstration scaled by the ratio of the bounding boxes. All three run
through the same pipeline (`upplied.planning.plan`), chosen by these settings alone.
"""

from __future__ import annotations

from upplied.config.settings import PRESETS, Preset, Settings, digest, settings_for
from upplied.config.stages import (
    FIDELITIES,
    CloudSettings,
    CorrespondenceSettings,
    Fidelity,
    InspectionSettings,
    OptimiseSettings,
    RefineSettings,
    RegistrationSettings,
    RequiredSettings,
    RetimeSettings,
    RouteSettings,
    TransferSettings,
    VehicleSettings,
    VerdictSettings,
    ViewpointSettings,
    VisibilitySettings,
    focal_px,
)

__all__ = [
    "FIDELITIES",
    "PRESETS",
    "CloudSettings",
    "CorrespondenceSettings",
    "Fidelity",
    "InspectionSettings",
    "OptimiseSettings",
    "Preset",
    "RefineSettings",
    "RegistrationSettings",
    "RequiredSettings",
    "RetimeSettings",
    "RouteSettings",
    "Settings",
    "TransferSettings",
    "VehicleSettings",
    "VerdictSettings",
    "ViewpointSettings",
    "VisibilitySettings",
    "digest",
    "focal_px",
    "settings_for",
]
