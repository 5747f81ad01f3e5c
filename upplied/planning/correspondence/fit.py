"""Two clouds of one sort, how one is registered on the other, and what corresponds to what."""

from dataclasses import dataclass, replace

import numpy as np

from upplied.config import Settings, settings_for
from upplied.planning.constants import LEAST_PART
from upplied.planning.geometry.clouds import in_source_frame
from upplied.planning.surface.parts import labels_of, parts_of
from upplied.records import Cloud, Correspondences, Ints, Record, Registration

NOTHING = Correspondences(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)))


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Record):
    """Two clouds of one sort, and how one is registered on the other."""

    source: Cloud
    target: Cloud
    registration: Registration
    correspondences: Correspondences = NOTHING  # from source to target
    # 0 or 1: the parts of the source or the target were inferred, from those of the other or of a sibling
    inferred: int = -1
    # (M,) the source's part that a smooth displacement alone brings onto each target sample, -1 where none
    carried: Ints | None = None
    labelling: "Labelling | None" = None  # where a sibling labelled the parts

    @property
    def registered(self) -> Cloud:
        """The target in the frame and at the scale of the source."""
        return self.derived("registered", lambda: in_source_frame(self.target, self.registration))


@dataclass(frozen=True, eq=False, repr=False)
class Labelling(Record):
    """The fits by which a sibling labelled the parts of a target, and of a source without parts."""

    sibling_id: str
    sha256: str  # of the sibling
    to_target: Fit  # from the sibling
    to_sibling: Fit | None  # from the source, where it has parts
    to_source: Fit | None  # from the sibling, where the source has none
    by_source: Fit | None  # the pair by the source's parts alone, where it has some


def explained(fit: Fit) -> float:
    """Share of the surface that lies on parts which were matched, of the structure with less of it."""
    match = fit.correspondences
    shares = [
        float(parts_of(cloud).area[known >= 0].sum())
        for cloud, known in ((fit.source, match.source_class), (fit.target, match.target_class))
        if known is not None
    ]
    return min(shares, default=0.0)


def named_by_displacement(fit: Fit) -> Ints:
    """The part of the source (M,) that is brought onto each sample of the target; -1 unless boxes left both.

    A nacelle with its pylon has another box than one without.
    """
    here, there = fit.correspondences.source_class, fit.correspondences.target_class
    if fit.carried is None or here is None or there is None:
        return np.full(len(fit.target), -1)
    left = (there < 0) & (parts_of(fit.target).area > LEAST_PART)
    return np.where(left[labels_of(fit.target)] & (here[fit.carried] < 0), fit.carried, -1)


def concentration(cloud: Cloud) -> float:
    """The probability that two places of a surface lie on the same part: 1 where it is one."""
    return float((parts_of(cloud).area ** 2).sum())


def voxel_settings(settings: Settings) -> Settings:
    """How the paper's clouds are fitted: as the preset says if it plans on them, else as published."""
    if not settings.visibility.occlusion:
        return settings
    return replace(settings_for("paper"), clouds=settings.clouds)


def surface_settings(settings: Settings) -> Settings:
    """How the surfaces are fitted, the ruler of every preset: as `recommended` does."""
    if settings.visibility.occlusion:
        return settings
    recommended = settings_for("recommended")
    matching = replace(recommended.correspondence, counterparts=settings.correspondence.counterparts)
    return replace(recommended, clouds=settings.clouds, correspondence=matching)


def without_counterparts(settings: Settings) -> Settings:
    """The settings without counterparts that the user named."""
    return replace(settings, correspondence=replace(settings.correspondence, counterparts=()))
