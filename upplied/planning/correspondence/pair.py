"""What is found out once about a pair of structures, whoever flew and whatever was inspected."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from upplied.config import CloudSettings, Settings, digest
from upplied.planning.constants import CLEARLY_BETTER, MAJORITY
from upplied.planning.correspondence.by_parts import by_displacement
from upplied.planning.correspondence.fit import (
    NOTHING,
    Fit,
    explained,
    number_of_parts,
    surface_settings,
    unasked,
    voxel_settings,
)
from upplied.planning.correspondence.label_transfer import carried, has_parts, parts_like
from upplied.planning.correspondence.memo import Memo, content_key, no_memo, remembering, surface_key
from upplied.planning.correspondence.nearest import correspond, nearest
from upplied.planning.correspondence.never_scanned import (
    NeverScanned,
    missing_from,
    supposed_surface,
    without,
)
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.correspondence.registration import Declared, declared_for, register
from upplied.planning.correspondence.rotor import rotor_turned
from upplied.planning.surface.fine import with_fine
from upplied.planning.surface.parts import blades_of, pieces_tell_parts
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import PartLabels, Skin, middle_of, skin_study
from upplied.planning.surface.thinning import voxel_cloud
from upplied.records import (
    Bools,
    Cloud,
    Correspondences,
    Ints,
    Record,
    Registration,
    Structure,
    SupposedSurface,
)
from upplied.scene import Scene, scene_of
from upplied.supposed_scene import obstacle, with_supposed


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
    missing: NeverScanned  # of the target
    supposed: SupposedSurface | None  # where that is; `target_scene` holds it
    grain: str = ""  # names the samples of the target's surface, where they are not its even ones

    @property
    def obstacle(self) -> Cloud:
        """The target's surface samples, and where more of it is supposed."""
        return self.derived("obstacle", lambda: obstacle(self.surface.target, self.supposed))

    def fit_for(self, settings: Settings) -> Fit:
        """The fit that a preset plans on: with normals where it asks what is truly seen."""
        return self.surface if settings.visibility.occlusion else self.voxels

    def with_samples(self, source: Grained, target: Grained) -> Pair:
        """The same pair by other samples of both surfaces; parts correspond as they did."""
        fit = self.surface
        cloud = source.cloud, target.cloud
        carried = None if fit.carried is None else fit.carried[target.even]
        fit = replace(fit, source=cloud[0], target=cloud[1], carried=carried)
        known, found = self.surface.correspondences, self.surface.registration
        if known.displacement is None or known.source_class is None or known.target_class is None:
            match = nearest(*cloud, found)
        else:
            matching = Matching(known.source_class, known.target_class)
            match = by_displacement(cloud[0], fit.registered, found, matching, known.displacement)
        beyond = np.flatnonzero(np.isin(source.even, self.missing.beyond))
        match = without(match, replace(self.missing, beyond=beyond), *cloud, carried)
        fit = replace(fit, correspondences=replace(match, summary=known.summary))
        return replace(self, surface=fit, grain=target.key)


@dataclass(frozen=True, eq=False, repr=False)
class Grained(Record):
    """Samples of a structure's surface that are finer where it matters."""

    cloud: Cloud
    even: Ints  # (N,) the even sample that each is, or that stands for it
    key: str  # names them


def grained(
    structure: Structure, cloud: Cloud, meant: Bools, clouds: CloudSettings, memo: Memo = no_memo
) -> Grained:
    """A structure's samples, finer where something is meant (N,), remembered."""
    # Parts are of the pair, where those of one structure are inferred from the other's.
    facts = np.flatnonzero(meant).tolist(), [] if cloud.part is None else cloud.part.tolist()
    key = content_key("fine", structure.sha256, clouds, digest(facts))
    memo = remembering(memo, structure.sha256)

    def finer() -> Grained:
        return Grained(*with_fine(structure, scene_of(structure), cloud, meant, clouds.seed), key)

    return memo("fine", Grained, key, finer)


def study_pair(source: Structure, target: Structure, settings: Settings, memo: Memo = no_memo) -> Pair:
    """Clouds, registration and correspondences of a pair (paper, Alg. 1), remembered by content.

    Both structures may be given in frames of their own (`surface.frames`).
    """
    memo = remembering(memo, source.sha256, target.sha256)
    scenes, clouds = (scene_of(source), scene_of(target)), settings.clouds
    voxels = _voxels(source, clouds, memo), _voxels(target, clouds, memo)
    declared = declared_for(source, target)
    surface = surfaces(source, target, settings, memo)
    stood = declared
    if settings.visibility.occlusion:  # what is published knows no turn: it has the one of the surfaces
        stood = replace(declared, turn=surface.registration.rotation @ surface.registration.turn)
    missing = missing_from(surface, (source, target), scenes, settings.clouds, memo)
    supposed = supposed_surface(missing)
    clouds_known = surface.source, surface.target, surface.carried
    surface = replace(surface, correspondences=without(surface.correspondences, missing, *clouds_known))
    return Pair(
        source,
        target,
        scenes[0],
        with_supposed(scenes[1], supposed),
        missing=missing,
        supposed=supposed,
        voxels=_fit("voxels", voxels, (source, target), voxel_settings(settings), stood, memo),
        surface=surface,
    )


def surfaces(source: Structure, target: Structure, settings: Settings, memo: Memo = no_memo) -> Fit:
    """The fit of the surfaces of a pair, `Pair.surface`, alone."""
    memo, scenes = remembering(memo, source.sha256, target.sha256), (scene_of(source), scene_of(target))
    samples = samples_of(source, settings, memo), samples_of(target, settings, memo)
    declared = declared_for(source, target)
    return _surface_fit(samples, (source, target), scenes, surface_settings(settings), declared, memo)


def told_surfaces(
    clouds: tuple[Cloud, Cloud],
    source: Structure,
    target: Structure,
    settings: Settings,
    told_by: str,
    memo: Memo = no_memo,
) -> Fit:
    """The same of surfaces whose parts a sibling told; `told_by` is its hash."""
    memo, settings = remembering(memo, source.sha256, target.sha256, told_by), surface_settings(settings)
    both, declared = (source, target), declared_for(source, target)
    facts = _facts("surface", both, settings, declared)
    found = _registered(clouds, settings, declared, memo, facts)
    facts = ("parts told", told_by, *facts)
    fit = Fit(*clouds, found, NOTHING, 1)
    fit = _with_parts(fit, both, unasked(settings), declared, memo, facts)
    return _as_asked(fit, both, settings, declared, memo, facts)


def surfaces_registered(
    source: Structure, target: Structure, settings: Settings, memo: Memo = no_memo
) -> Registration:
    """How the surface of a target is registered on that of a source."""
    memo, settings = remembering(memo, source.sha256, target.sha256), surface_settings(settings)
    samples = samples_of(source, settings, memo), samples_of(target, settings, memo)
    declared = declared_for(source, target)
    facts = _facts("surface", (source, target), settings, declared)
    return _registered(samples, settings, declared, memo, facts)


def _voxels(structure: Structure, clouds: CloudSettings, memo: Memo) -> Cloud:
    key = content_key("voxels", structure.sha256, clouds)
    return memo("clouds", Cloud, key, lambda: voxel_cloud(structure, clouds))


def samples_of(structure: Structure, settings: Settings, memo: Memo = no_memo) -> Cloud:
    """Samples of a structure's surface, remembered with it."""
    clouds, memo = settings.clouds, remembering(memo, structure.sha256)
    key = surface_key(structure.sha256, clouds)
    return memo("clouds", Cloud, key, lambda: surface_samples(structure, scene_of(structure), clouds))


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
    plain = unasked(settings)
    found = _registered(clouds, settings, declared, memo, facts)
    known = [pieces_tell_parts(cloud) for cloud in clouds]
    fit = Fit(*clouds, found, NOTHING)
    if known[0] == known[1]:
        both = _matched(clouds, structures, found, plain, declared, memo, facts)
        fit = replace(fit, correspondences=both)
    scanned = any(each.is_scan for each in structures)
    if any(known) and (scanned or known[0] != known[1]) and explained(fit) < MAJORITY:
        fewer = number_of_parts(clouds[1]) <= number_of_parts(clouds[0])
        one = int(fewer if known[0] == known[1] else known[0])
        inferred = _fit_inferred(fit, one, structures, scenes, plain, declared, memo, facts)
        if known[0] != known[1] or CLEARLY_BETTER * explained(inferred) > explained(fit):
            fit, facts = inferred, ("parts inferred", *facts)
    fit = _as_asked(fit, structures, settings, declared, memo, facts)
    unknown = fit.carried is None and has_parts(fit.source) and has_parts(fit.target)
    return _with_carried(fit, memo, facts) if unknown else fit


def _as_asked(
    fit: Fit,
    structures: tuple[Structure, Structure],
    settings: Settings,
    declared: Declared,
    memo: Memo,
    facts: tuple[Any, ...],
) -> Fit:
    """A fit, matched again where a user says what corresponds to what."""
    if not settings.correspondence.counterparts:
        return fit
    of = fit.source, fit.target
    asked = _matched(of, structures, fit.registration, settings, declared, memo, facts, fit.carried)
    return replace(fit, correspondences=asked)


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
        return PartLabels(parts_like(registered[one], middle_of(skin.of(clouds[one])), turned))

    known = replace(clouds[one], part=memo("parts", PartLabels, content_key("parts", *facts), inferred).label)
    clouds = (known, clouds[1]) if one == 0 else (clouds[0], known)
    facts = ("parts inferred", *facts)
    return _with_parts(Fit(*clouds, found, NOTHING, one), structures, settings, declared, memo, facts)


def _with_parts(
    fit: Fit,
    structures: tuple[Structure, Structure],
    settings: Settings,
    declared: Declared,
    memo: Memo,
    facts: tuple[Any, ...],
) -> Fit:
    """A fit of which parts were inferred, those of both matched."""
    clouds, found = (fit.source, fit.target), fit.registration
    if blades_of(clouds[fit.inferred]).any():  # a rotor that stopped otherwise is registered body on body
        found = _registered(clouds, settings, declared, memo, facts)
    fit = _with_carried(replace(fit, registration=found), memo, facts)
    both = _matched(clouds, structures, found, settings, declared, memo, facts, fit.carried)
    return replace(fit, correspondences=both)


def _with_carried(fit: Fit, memo: Memo, facts: tuple[Any, ...]) -> Fit:
    key = content_key("carried", *facts)
    found = memo("parts", PartLabels, key, lambda: PartLabels(carried(fit.registered, fit.source)))
    return replace(fit, carried=found.label)


def skin_of(
    structure: Structure, scene: Scene, cloud: Cloud, clouds: CloudSettings, memo: Memo = no_memo
) -> Skin:
    """The stretches of a structure's skin, remembered with it."""
    key = content_key("skin", structure.sha256, clouds)
    memo = remembering(memo, structure.sha256)
    return memo("skin", Skin, key, lambda: skin_study(structure, scene, cloud, clouds.seed))
