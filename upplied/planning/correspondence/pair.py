"""What is found out once about a pair of structures, whoever flew and whatever was inspected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from upplied.config import CloudSettings, Settings, digest, settings_for
from upplied.planning.constants import CLEARLY_BETTER, LEAST_PART, MAJORITY
from upplied.planning.correspondence.label_transfer import carried, has_parts, parts_like, pieces_tell_parts
from upplied.planning.correspondence.nearest import correspond
from upplied.planning.correspondence.registration import Declared, register
from upplied.planning.correspondence.rotor import rotor_turned
from upplied.planning.geometry.boxes import in_source_frame
from upplied.planning.surface.frames import named_axes
from upplied.planning.surface.parts import blades_of, parts_of
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import PartLabels, skin_parts
from upplied.planning.surface.voxels import voxel_cloud
from upplied.provenance import method
from upplied.records import Cloud, Correspondences, Floats, Frame, Ints, Record, Registration, Structure
from upplied.scene import Scene, scene_of

_CIRCLE = 2**32  # distinct headings
METHOD_VERSION = "13"  # raised with every change that alters a result, for people; keys hold the sources too

R = TypeVar("R")


class Memo(Protocol):
    """Remembers results by content: the catalog's cache, or nothing at all."""

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        """The remembered record of this stage and key, or the computed one."""


def no_memo(stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
    """Computes every time."""
    return compute()


def remembering(memo: Memo, *hashes: str) -> Memo:
    """The memo where all inputs have a hash to remember them by, else none."""
    return memo if all(hashes) else no_memo


_NOTHING = Correspondences(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)))


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Record):
    """Two clouds of one sort, and how one is registered on the other."""

    source: Cloud
    target: Cloud
    registration: Registration
    correspondences: Correspondences  # from source to target
    inferred: int = -1  # 0 or 1: the parts of the source or the target were inferred from those of the other
    # (M,) the source's part that a smooth displacement alone brings onto each target sample, -1 where none
    carried: Ints | None = None

    @property
    def registered(self) -> Cloud:
        """The target in the frame and at the scale of the source."""
        return self.derived("registered", lambda: in_source_frame(self.target, self.registration))


@dataclass(frozen=True, eq=False, repr=False)
class Pair(Record):
    """Two structures and how they fit.

    `voxels` are the paper's clouds and what follows from them. `surface` is the ruler by which
    every plan is measured, whatever its preset, and what `recommended` plans on.
    """

    source: Structure
    target: Structure
    source_scene: Scene
    target_scene: Scene
    voxels: Fit
    surface: Fit

    def fit_for(self, settings: Settings) -> Fit:
        """The fit that a preset plans on: with normals where it asks what is truly seen."""
        return self.surface if settings.visibility.occlusion else self.voxels


def study_pair(source: Structure, target: Structure, settings: Settings, memo: Memo = no_memo) -> Pair:
    """Clouds, registration and correspondences of a pair (paper, Alg. 1), remembered by content.

    Both structures may be given in frames of their own (`surface.frames`).
    """
    memo = remembering(memo, source.sha256, target.sha256)
    scenes, clouds = (scene_of(source), scene_of(target)), settings.clouds
    voxels = _voxels(source, clouds, memo), _voxels(target, clouds, memo)
    samples = _samples(source, scenes[0], clouds, memo), _samples(target, scenes[1], clouds, memo)
    declared = Declared(_declared_turn(source, target), named_axes(source.frame))
    surface = _surface_fit(samples, (source, target), scenes, surface_settings(settings), declared, memo)
    stood = declared
    if settings.visibility.occlusion:  # what is published knows no turn: it has the one of the surfaces
        stood = replace(declared, turn=surface.registration.rotation @ surface.registration.turn)
    return Pair(
        source,
        target,
        *scenes,
        voxels=_fit("voxels", voxels, (source, target), voxel_settings(settings), stood, memo),
        surface=surface,
    )


def _declared_turn(source: Structure, target: Structure) -> Floats:
    """The target's frame to the source's, where both are declared to stand alike."""
    circle = (target.frame.heading_rad - source.frame.heading_rad) / (2 * np.pi)
    # Rounded, so that equal structures in other axes give the same number, and a whole circle none.
    return Frame(2 * np.pi * float(np.round(circle * _CIRCLE) % _CIRCLE / _CIRCLE)).turn


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


def content_key(*parts: Any) -> str:
    """Key of a result in the cache: the method as it is, its libraries, and all that went in."""
    return digest({"method": METHOD_VERSION, **method(), "parts": [digest(part) for part in parts]})


def surface_key(structure_sha256: str, clouds: CloudSettings) -> str:
    """Key of a structure's surface samples."""
    return content_key("surface", structure_sha256, clouds)


def _with_clouds(preset: str, settings: Settings) -> Settings:
    return replace(settings_for(preset), clouds=settings.clouds)


def _voxels(structure: Structure, clouds: CloudSettings, memo: Memo) -> Cloud:
    key = content_key("voxels", structure.sha256, clouds)
    return memo("clouds", Cloud, key, lambda: voxel_cloud(structure, clouds))


def _samples(structure: Structure, scene: Scene, clouds: CloudSettings, memo: Memo) -> Cloud:
    key = surface_key(structure.sha256, clouds)
    return memo("clouds", Cloud, key, lambda: surface_samples(structure, scene, clouds))


def _fit(
    sort: str,
    clouds: tuple[Cloud, Cloud],
    structures: tuple[Structure, Structure],
    settings: Settings,
    declared: Declared,
    memo: Memo,
) -> Fit:
    facts = _facts(sort, structures, settings, declared)
    found = _registered(clouds, settings, declared, memo, facts)
    return Fit(*clouds, found, _matched(clouds, structures, found, settings, declared, memo, facts))


def _facts(
    sort: str, structures: tuple[Structure, Structure], settings: Settings, declared: Declared
) -> tuple[Any, ...]:
    """What a fit depends on besides the method."""
    turned = () if np.array_equal(declared.turn, np.eye(3)) else (declared.turn.tolist(),)
    return sort, *(each.sha256 for each in structures), settings.clouds, settings.registration, *turned


def _registered(
    clouds: tuple[Cloud, Cloud], settings: Settings, declared: Declared, memo: Memo, facts: tuple[Any, ...]
) -> Registration:
    key = content_key("register", *facts)
    return memo("registration", Registration, key, lambda: register(*clouds, settings.registration, declared))


def _matched(
    clouds: tuple[Cloud, Cloud],
    structures: tuple[Structure, Structure],
    found: Registration,
    settings: Settings,
    declared: Declared,
    memo: Memo,
    facts: tuple[Any, ...],
    named: Ints | None = None,
) -> Correspondences:
    landmarks = structures[0].landmarks, structures[1].landmarks
    return memo(
        "correspondences",
        Correspondences,
        content_key("correspond", *facts, settings.correspondence),
        lambda: correspond(*clouds, found, settings.correspondence, *landmarks, declared.words, named),
    )


def _surface_fit(
    clouds: tuple[Cloud, Cloud],
    structures: tuple[Structure, Structure],
    scenes: tuple[Scene, Scene],
    settings: Settings,
    declared: Declared,
    memo: Memo,
) -> Fit:
    """The fit of the surfaces; where pieces do not tell the parts of one of them, the other one does."""
    facts = _facts("surface", structures, settings, declared)
    # Which parts there are does not depend on what a user says of them.
    unasked = replace(settings, correspondence=replace(settings.correspondence, counterparts=()))
    found = _registered(clouds, settings, declared, memo, facts)
    known = [pieces_tell_parts(cloud) for cloud in clouds]
    fit = Fit(*clouds, found, _NOTHING)
    if known[0] == known[1]:
        both = _matched(clouds, structures, found, unasked, declared, memo, facts)
        fit = replace(fit, correspondences=both)
    if any(known) and _explained(fit) < MAJORITY:
        fewer = _number(clouds[1]) <= _number(clouds[0])  # where both have parts: one of few pieces is a scan
        one = int(fewer if known[0] == known[1] else known[0])
        inferred = _fit_inferred(fit, one, structures, scenes, unasked, declared, memo, facts)
        if known[0] != known[1] or CLEARLY_BETTER * _explained(inferred) > _explained(fit):
            fit, facts = inferred, ("parts inferred", *facts)
    if settings.correspondence.counterparts:
        of = fit.source, fit.target
        asked = _matched(of, structures, fit.registration, settings, declared, memo, facts, fit.carried)
        fit = replace(fit, correspondences=asked)
    unknown = fit.carried is None and has_parts(fit.source) and has_parts(fit.target)
    return _with_carried(fit, memo, facts) if unknown else fit


def _fit_inferred(
    fit: Fit,
    one: int,
    structures: tuple[Structure, Structure],
    scenes: tuple[Scene, Scene],
    settings: Settings,
    declared: Declared,
    memo: Memo,
    facts: tuple[Any, ...],
) -> Fit:
    """The fit where the parts of the source (0) or of the target (1) are inferred from those of the other."""
    clouds, found = (fit.source, fit.target), fit.registration
    registered = clouds[0], fit.registered

    def inferred() -> PartLabels:
        skin = skin_of(structures[one], scenes[one], clouds[one], settings.clouds, memo)
        turned = rotor_turned(registered[1 - one], registered[one])
        return PartLabels(parts_like(registered[one], skin.label, turned))

    known = replace(clouds[one], part=memo("parts", PartLabels, content_key("parts", *facts), inferred).label)
    clouds = (known, clouds[1]) if one == 0 else (clouds[0], known)
    facts = ("parts inferred", *facts)
    if blades_of(known).any():  # a rotor that stopped otherwise is registered body on body
        found = _registered(clouds, settings, declared, memo, facts)
    fit = _with_carried(Fit(*clouds, found, _NOTHING, one), memo, facts)
    both = _matched(clouds, structures, found, settings, declared, memo, facts, fit.carried)
    return replace(fit, correspondences=both)


def _explained(fit: Fit) -> float:
    """Share of the surface that lies on parts which were matched, of the structure with less of it."""
    match = fit.correspondences
    shares = [
        float(parts_of(cloud).area[known >= 0].sum())
        for cloud, known in ((fit.source, match.source_class), (fit.target, match.target_class))
        if known is not None
    ]
    return min(shares, default=0.0)


def _number(cloud: Cloud) -> int:
    """How many parts of some size there are."""
    return int((parts_of(cloud).area > LEAST_PART).sum())


def _with_carried(fit: Fit, memo: Memo, facts: tuple[Any, ...]) -> Fit:
    key = content_key("carried", *facts)
    found = memo("parts", PartLabels, key, lambda: PartLabels(carried(fit.registered, fit.source)))
    return replace(fit, carried=found.label)


def skin_of(
    structure: Structure, scene: Scene, cloud: Cloud, clouds: CloudSettings, memo: Memo = no_memo
) -> PartLabels:
    """The parts of a structure's skin, remembered with it."""
    key = content_key("skin", structure.sha256, clouds)
    memo = remembering(memo, structure.sha256)
    return memo("skin", PartLabels, key, lambda: skin_parts(structure, scene, cloud, clouds.seed))
