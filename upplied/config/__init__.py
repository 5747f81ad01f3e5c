"""Settings: one frozen class per stage, each default in one place, and the presets.

``paper`` is the method as published, ``recommended`` is for flying, ``baseline`` is the paper's peer, the
demonstration scaled by the ratio of the bounding boxes. One pipeline (`upplied.planning.plan`) runs them all.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args, get_origin, get_type_hints

from upplied.config.stages import FIDELITIES as FIDELITIES
from upplied.config.stages import (
    CloudSettings,
    CorrespondenceSettings,
    InspectionSettings,
    OptimiseSettings,
    Range,
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
)
from upplied.config.stages import Fidelity as Fidelity
from upplied.config.stages import focal_px as focal_px
from upplied.errors import SettingsError

PRESETS = ("paper", "recommended", "baseline")
Preset = Literal["paper", "recommended", "baseline"]


@dataclass(frozen=True)
class Settings:
    """Everything that a plan depends on besides the demonstration and the two structures."""

    preset: Preset = "recommended"
    clouds: CloudSettings = field(default_factory=CloudSettings)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)
    correspondence: CorrespondenceSettings = field(default_factory=CorrespondenceSettings)
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)
    viewpoints: ViewpointSettings = field(default_factory=ViewpointSettings)
    transfer: TransferSettings = field(default_factory=TransferSettings)
    refine: RefineSettings = field(default_factory=RefineSettings)
    optimise: OptimiseSettings = field(default_factory=OptimiseSettings)
    route: RouteSettings = field(default_factory=RouteSettings)
    retime: RetimeSettings = field(default_factory=RetimeSettings)
    inspection: InspectionSettings = field(default_factory=InspectionSettings)
    verdict: VerdictSettings = field(default_factory=VerdictSettings)
    required: RequiredSettings = field(default_factory=RequiredSettings)
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)

    @cached_property
    def sha256(self) -> str:
        """Hash of every setting as it is written: 1 and 1.0 are two."""
        return digest(self)

    @cached_property
    def text(self) -> str:
        plain = asdict(self)
        return json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def settings_for(preset: str, **changes: Any) -> Settings:
    """The settings of a preset, with single stages replaced.

    Parameters
    ----------
    preset : {"paper", "recommended", "baseline"}
    **changes
        Stage name to a mapping of setting names to values, e.g. ``route={"clearance_m": 3.0}``.

    Raises
    ------
    SettingsError
        If the preset, a stage, a setting or the type of a value is unknown.

    Examples
    --------
    >>> settings_for("paper", route={"clearance_m": 3.0}).route.clearance_m
    3.0
    """
    try:
        settings = _PRESETS[preset]
    except KeyError:
        raise SettingsError(f"preset {preset!r}", "is unknown", f"one of {', '.join(PRESETS)}") from None
    for stage, values in changes.items():
        settings = replace(settings, **{stage: _changed(settings, stage, values)})
    low, high = settings.retime.min_gimbal_pitch_deg, settings.retime.max_gimbal_pitch_deg
    if low > high:
        fault = f"got {low:g}, above retime.max_gimbal_pitch_deg, which is {high:g}"
        rule = "the least pitch of the gimbal is not above the largest"
        raise SettingsError("setting retime.min_gimbal_pitch_deg", fault, rule)
    return settings


def _changed(settings: Settings, stage: str, values: Mapping[str, Any]) -> Any:
    stages = [item.name for item in fields(settings) if item.name != "preset"]
    if stage not in stages:
        raise SettingsError(f"settings stage {stage!r}", "is unknown", f"one of {', '.join(stages)}")
    before = getattr(settings, stage)
    known = [item.name for item in fields(before)]
    for name, value in values.items():
        if name not in known:
            raise SettingsError(f"setting {stage}.{name}", "is unknown", f"one of {', '.join(known)}")
        _check_value(stage, type(before), name, value)
    return replace(before, **values)


def range_of(stage: type, name: str) -> Range:
    """The range of a number of a stage; the whole line where none is declared."""
    hint = get_type_hints(stage, include_extras=True)[name]
    notes = (note for part in (hint, *get_args(hint)) for note in getattr(part, "__metadata__", ()))
    return next(notes, Range(-math.inf, math.inf))


def _check_value(stage_name: str, stage: type, name: str, value: Any) -> None:
    """Refuse a value of a stage of another type than its field declares, or out of its range."""
    hint = get_type_hints(stage)[name]
    what, choices = f"setting {stage_name}.{name}", get_args(hint)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if get_origin(hint) is Literal:
        fits, rule = value in choices, f"one of {', '.join(map(repr, choices))}"
    elif hint is str:
        fits, rule = isinstance(value, str) and len(value) <= 1000, "text of at most 1000 characters"
    elif hint is bool:
        fits, rule = isinstance(value, bool), "true or false"
    elif int in (hint, *choices):
        fits, rule = number and isinstance(value, int), "a whole number"
    elif float in (hint, *choices):
        fits, rule = number and math.isfinite(value), "a number"
    else:
        fits = all(isinstance(pair, tuple | list) and len(pair) == 2 for pair in value)
        rule = "pairs of names"
    if type(None) in choices:
        fits, rule = fits or value is None, f"{rule}, or none"
    if not fits:
        raise SettingsError(what, f"got {value!r}", rule)
    low, high = range_of(stage, name)
    if isinstance(value, int | float) and not low <= value <= high:
        raise SettingsError(what, f"got {value!r}", f"{low:g} to {high:g}")


def digest(value: Any) -> str:
    """SHA-256 of the canonical JSON of dataclasses, mappings and plain values (hex, 64 digits)."""
    plain = asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()


_PAPER = Settings(preset="paper")
_PRESETS: dict[str, Settings] = {
    "paper": _PAPER,
    "recommended": replace(
        _PAPER,
        preset="recommended",
        registration=RegistrationSettings(acceptance=1.0, least_probability=0.8),
        correspondence=CorrespondenceSettings(method="parts", least_probability=0.8, siblings=3),
        visibility=VisibilitySettings(occlusion=True, max_incidence_deg=75.0),
        transfer=TransferSettings(method="counterparts", standoff="kept"),
        refine=RefineSettings(method="view"),
        route=RouteSettings(enforce=True),
        verdict=VerdictSettings(enforce=True),
        retime=RetimeSettings(limits=True),
    ),
    "baseline": replace(
        _PAPER,
        preset="baseline",
        registration=RegistrationSettings(gamma=1e9),  # the baseline refuses no pair
        viewpoints=ViewpointSettings(method="poses"),
        transfer=TransferSettings(method="box"),
        refine=RefineSettings(method="none"),
    ),
}
