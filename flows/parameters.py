"""The parameters of the flows: wrong ones are refused when a run is submitted, not when it runs."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model

from upplied.config import Preset, Settings
from upplied.inputs.passport.rules import RULES as FLIGHT_RULES
from upplied.inputs.rules import RULES as STRUCTURE_RULES
from upplied.inputs.rules import PassportSettings, StructureSettings

Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
Location = Annotated[str, Field(min_length=1, description="A folder, or the URI of an object store.")]
Millimetres = Annotated[float, Field(gt=0, lt=1e4)]
Presets = Annotated[list[Preset], Field(min_length=1)]
Engine = Literal["local", "pool", "dask", "ray"]


def _partial(name: str, settings: type, words: str | None, default: Any = None) -> type[BaseModel]:
    """A model of settings in which everything may be left out."""
    hints = get_type_hints(settings)
    values: dict[str, Any] = {item.name: (hints[item.name] | None, default) for item in fields(settings)}
    return create_model(name, __config__=ConfigDict(extra="forbid"), __doc__=words, **values)


_STAGES: dict[str, Any] = {
    name: (_partial(stage.__name__, stage, stage.__doc__) | None, None)
    for name, stage in get_type_hints(Settings).items()
    if name != "preset"
}
_WORDS = "Settings that differ from the preset's, by stage."
#: A model of the settings: what is given replaces the preset's.
Changes = create_model("Changes", __config__=ConfigDict(extra="forbid"), __doc__=_WORDS, **_STAGES)


def _bounds(settings: type, least: float) -> type[BaseModel]:
    """A model of the bounds of rules, as `--set` takes them."""
    limits = Field(None, ge=0, gt=least, lt=1e9)
    words = "Bounds of rules that differ from their defaults (docs/checks.md)."
    return _partial(f"Bounds{settings.__name__}", settings, words, limits)


FlightRule = Literal[tuple(sorted(FLIGHT_RULES))]  # type: ignore[valid-type]
FlightBounds = _bounds(PassportSettings, -1.0)
StructureRule = Literal[tuple(sorted(STRUCTURE_RULES))]  # type: ignore[valid-type]
StructureBounds = _bounds(StructureSettings, 0.0)


def bound_options(bounds: BaseModel) -> list[str]:
    """Bounds as `--set` says them."""
    values = bounds.model_dump(exclude_unset=True, exclude_none=True)
    return [f"{name}={value!r}" for name, value in values.items()]


class Resources(BaseModel):
    """What a run may use."""

    model_config = ConfigDict(extra="forbid")

    workers: int = Field(0, ge=0, le=1024, description="Processes; 0 takes one per core.")
    timeout_s: float = Field(600, gt=0, description="After this a target is stopped and marked failed.")
    memory_gib: float | None = Field(None, gt=0, description="Memory of a worker; by default its share.")
    engine: Engine = Field(
        "local",
        description="Where targets are planned: local processes, a work pool's machines, Dask or Ray.",
    )
    address: str = Field("", description="Of the running Dask or Ray cluster.")
    shard_targets: int = Field(
        0, ge=0, le=10_000, description="Targets in each job of the work pool; 0 distributes them evenly."
    )
    most_lost: float = Field(
        0.5,
        ge=0,
        le=1,
        description="Share of shards that the engine may lose before the run fails; the run plans them.",
    )


ALL_CORES = Resources()
