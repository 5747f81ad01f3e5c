"""By which settings the paper's clouds and the surfaces of a pair are fitted."""

from __future__ import annotations

from dataclasses import replace

from upplied.config import Settings, settings_for


def voxel_settings(settings: Settings) -> Settings:
    """How the paper's clouds are fitted: as the preset says if it plans on them, else as published."""
    return settings if not settings.visibility.occlusion else _with_clouds("paper", settings)


def surface_settings(settings: Settings) -> Settings:
    """How the surfaces are fitted, the ruler of every preset: as `recommended` does."""
    if settings.visibility.occlusion:
        return settings
    recommended = _with_clouds("recommended", settings)
    wanted = replace(recommended.correspondence, counterparts=settings.correspondence.counterparts)
    return replace(recommended, correspondence=wanted)


def unasked(settings: Settings) -> Settings:
    """The same settings, nothing said of what corresponds to what."""
    return replace(settings, correspondence=replace(settings.correspondence, counterparts=()))


def _with_clouds(preset: str, settings: Settings) -> Settings:
    return replace(settings_for(preset), clouds=settings.clouds)
