"""What is found out once about a pair of structures, whoever flew and whatever was inspected."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from upplied.config import CloudSettings, Settings, digest
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import obstacle, with_supposed
from upplied.planning.constants import CLEARLY_BETTER, MAJORITY
from upplied.planning.correspondence.correspondences import by_displacement, correspond, nearest
from upplied.planning.correspondence.fit import (
    Fit,
    concentration,
    explained,
    named_by_displacement,
    surface_settings,
    voxel_settings,
    without_counterparts,
)
from upplied.planning.correspondence.label_transfer import carried, has_parts, parts_like
from upplied.planning.correspondence.memo import Memo, content_key, no_memo, remembering
from upplied.planning.correspondence.never_scanned import (
    NOTHING_MISSING,
    NeverScanned,
    never_scanned,
    without,
)
from upplied.planning.correspondence.part_alignment import rotor_turned
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.correspondence.registration import Declared, declared_for, register
from upplied.planning.surface.lattice import voxel_cloud
from upplied.planning.surface.parts import blades_of, pieces_tell_parts
from upplied.planning.surface.samples import surface_samples, with_fine
from upplied.planning.surface.skin import PartLabels, Skin, middle_of, skin_study
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

R = TypeVar("R")


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
    missing: NeverScanned  # of the target; `target_scene` holds where that is
    grain: str = ""  # names the samples of the target's surface, where they are not its even ones

    @property
    def supposed(self) -> SupposedSurface | None:
        """Surface where nothing of the target was scanned."""
        return self.missing.supposed

    @property
    def obstacle(self) -> Cloud:
        """The target's surface samples, and where more of it is supposed."""
        return self.derived("obstacle", lambda: obstacle(self.surface.target, self.supposed))

    def fit_for(self, settings: Settings) -> Fit:
        """The fit that a preset plans on: with normals where it asks what is truly seen."""
        return self.surface if settings.visibility.occlusion else self.voxels

    def with_samples(self, source: "Grained", target: "Grained") -> "Pair":
        """The same pair by other samples of both surfaces; parts correspond as they did."""
        match, registration = self.surface.correspondences, self.surface.registration
        labels = None if self.surface.carried is None else self.surface.carried[target.even]
        fit = replace(self.surface, source=source.cloud, target=target.cloud, carried=labels)
        if match.displacement is None or match.source_class is None or match.target_class is None:
            finer = nearest(fit.source, fit.target, registration)
        else:
            matching = Matching(match.source_class, match.target_class)
            finer = by_displacement(fit.source, fit.registered, registration, matching, match.displacement)
        beyond = np.flatnonzero(np.isin(source.even, self.missing.beyond))
        finer = without(finer, replace(self.missing, beyond=beyond), fit.source, fit.target, labels)
        fit = replace(fit, correspondences=replace(finer, summary=match.summary))
        return replace(self, surface=fit, grain=target.key)


@dataclass(frozen=True, eq=False, repr=False)
class Grained(Record):
    """Samples of a structure's surface that are finer where it matters."""

    cloud: Cloud
    even: Ints  # (N,) the even sample that each is, or that stands for it
    key: str  # names them


def grained(
    structure: Structure, cloud: Cloud, zone: Bools, clouds: CloudSettings, memo: Memo = no_memo
) -> Grained:
    """A structure's samples, finer where something is meant (N,), remembered."""
    # Parts are of the pair, where those of one structure are inferred from the other's.
    facts = np.flatnonzero(zone).tolist(), [] if cloud.part is None else cloud.part.tolist()
    key = content_key("fine", structure.sha256, clouds, digest(facts))
    memo = remembering(memo, structure.sha256)
    sampled = partial(with_fine, structure, scene_of(structure), cloud, zone)
    return memo("fine", Grained, key, lambda: Grained(*sampled(), key))


def study_pair(source: Structure, target: Structure, settings: Settings, memo: Memo = no_memo) -> Pair:
    """Clouds, registration and correspondences of a pair (paper, Alg. 1), remembered by content.

    Both structures may be given in frames of their own (`surface.frames`).
    """
    return pair_of(surfaces_of(source, target, settings, memo), settings)


def pair_of(surfaces: "Task", settings: Settings, labelled: Fit | None = None) -> Pair:
    """A pair by the fit of its surfaces, or by one whose parts a sibling labelled."""
    source, target, memo = surfaces.source, surfaces.target, surfaces.memo
    scenes, fit = (scene_of(source), scene_of(target)), surface_fit(surfaces)
    missing, declared = surfaces.missing(fit), surfaces.declared
    if settings.visibility.occlusion:  # what is published knows no turn: it has the one of the surfaces
        declared = replace(declared, turn=fit.registration.rotation @ fit.registration.turn)
    clouds = _voxels(source, settings.clouds, memo), _voxels(target, settings.clouds, memo)
    voxels = Task(source, target, voxel_settings(settings), memo, clouds, declared, ("voxels",))
    fit = fit if labelled is None else labelled
    match = without(fit.correspondences, missing, fit.source, fit.target, fit.carried)
    return Pair(
        source,
        target,
        scenes[0],
        with_supposed(scenes[1], missing.supposed),
        missing=missing,
        voxels=voxels.matched(Fit(*clouds, voxels.registration())),
        surface=replace(fit, correspondences=match),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Task(Record):
    """Two structures whose clouds of one sort are to be fitted, and all that the fit depends on."""

    source: Structure
    target: Structure
    settings: Settings
    memo: Memo
    clouds: tuple[Cloud, Cloud]
    declared: Declared
    names: tuple[str, ...]  # of the clouds: their sort, and whose parts label them

    def remembered(self, stage: str, kind: type[R], compute: Callable[[], R], *more: Any) -> R:
        """A record of a stage, by all that it depends on."""
        hashes, settings = (self.source.sha256, self.target.sha256), self.settings
        facts = *hashes, settings.clouds, settings.registration, self.declared.turn.tolist()
        return self.memo(stage, kind, content_key(stage, *self.names, *facts, *more), compute)

    def registration(self) -> Registration:
        """How the target lies on the source."""
        inputs = *self.clouds, self.settings.registration, self.declared
        return self.remembered("registration", Registration, lambda: register(*inputs))

    def matched(self, fit: Fit, named: Ints | None = None) -> Fit:
        """A fit with its parts and samples matched as the settings say, and by names (M,) of the target's."""
        named = fit.carried if named is None and fit.inferred >= 0 else named
        rule, marks = self.settings.correspondence, (self.source.landmarks, self.target.landmarks)
        clouds, words = (fit.source, fit.target), self.declared.words
        inputs = *clouds, fit.registration, rule, *marks, words, named
        facts = rule, *(() if named is None else ("named",))
        match = self.remembered("correspondences", Correspondences, lambda: correspond(*inputs), *facts)
        return replace(fit, correspondences=match)

    def with_carried(self, fit: Fit) -> Fit:
        """A fit with the source's part that a smooth displacement brings onto each target sample."""
        of = fit.registered, fit.source
        parts = self.remembered("carried", PartLabels, lambda: PartLabels(carried(*of)))
        return replace(fit, carried=parts.label)

    def labelled(self, clouds: tuple[Cloud, Cloud], by: str) -> "Task":
        """The same of clouds whose parts another structure labelled."""
        return replace(self, clouds=clouds, names=(*self.names, f"parts by {by}"))

    def fit_labelled(self, one: int, registration: Registration) -> Fit:
        """The fit of clouds of which the parts of the source (0) or the target (1) were labelled."""
        if blades_of(self.clouds[one]).any():  # a rotor that stopped otherwise is registered body on body
            registration = self.registration()
        fit = self.with_carried(Fit(*self.clouds, registration, inferred=one))
        return replace(self, settings=without_counterparts(self.settings)).matched(fit)

    def missing(self, fit: Fit) -> NeverScanned:
        """What of a fitted target was never scanned; nothing of one that is no scan."""
        if not self.target.is_scan:
            return NOTHING_MISSING
        of, lies = (self.source, self.target), fit.registration
        facts = lies.matrix.tolist(), lies.translation.tolist()
        return self.remembered("missing", NeverScanned, lambda: never_scanned(*of, fit), *facts)

    def as_named(self, fit: Fit) -> Fit:
        """A fit, matched again where the user names counterparts."""
        return self.matched(fit) if self.settings.correspondence.counterparts else fit


def surfaces_of(source: Structure, target: Structure, settings: Settings, memo: Memo = no_memo) -> Task:
    """The surfaces of a pair, to be fitted."""
    memo = remembering(memo, source.sha256, target.sha256)
    clouds = samples_of(source, settings, memo), samples_of(target, settings, memo)
    declared = declared_for(source, target)
    return Task(source, target, surface_settings(settings), memo, clouds, declared, ("surface",))


def surface_fit(task: Task) -> Fit:
    """The fit of the surfaces; where pieces do not tell the parts of one of them, the other one does.

    Parts that boxes leave correspond by what a smooth displacement brings onto them.
    """
    known = [pieces_tell_parts(cloud) for cloud in task.clouds]
    fit, same = Fit(*task.clouds, task.registration()), known[0] == known[1]
    # Which parts there are does not depend on counterparts that the user names.
    unnamed = replace(task, settings=without_counterparts(task.settings))
    if same:
        fit = unnamed.matched(fit)
    if any(known) and explained(fit) < MAJORITY:
        # The source's tell, which the flight is about, unless the target's are clearly finer.
        finer = concentration(fit.target) < CLEARLY_BETTER * concentration(fit.source)
        one = int(known[0] and not (same and finer))
        other = _with_inferred_parts(task, fit, one)
        inferred = other.fit_labelled(one, fit.registration)
        if not same or CLEARLY_BETTER * explained(inferred) > explained(fit):
            return other.as_named(inferred)
    if not (has_parts(fit.source) and has_parts(fit.target)):
        return task.as_named(fit)
    fit = task.with_carried(fit)
    named = named_by_displacement(fit)
    return task.matched(fit, named) if (named >= 0).any() else task.as_named(fit)


def _with_inferred_parts(task: Task, fit: Fit, one: int) -> Task:
    """The task with the parts of the source (0) or the target (1) inferred from those of the other."""
    structure, registered = (task.source, task.target)[one], (fit.source, fit.registered)

    def inferred() -> PartLabels:
        cloud = task.clouds[one]
        skin = skin_of(structure, scene_of(structure), cloud, task.settings.clouds, task.memo)
        turned = rotor_turned(registered[1 - one], registered[one])
        return PartLabels(parts_like(registered[one], middle_of(skin.of(cloud)), turned))

    clouds = list(task.clouds)
    clouds[one] = replace(clouds[one], part=task.remembered("parts", PartLabels, inferred).label)
    return task.labelled((clouds[0], clouds[1]), "the other")


def _voxels(structure: Structure, clouds: CloudSettings, memo: Memo) -> Cloud:
    key = content_key("voxels", structure.sha256, clouds)
    return memo("clouds", Cloud, key, partial(voxel_cloud, structure, clouds))


def samples_of(structure: Structure, settings: Settings, memo: Memo = no_memo) -> Cloud:
    """Samples of a structure's surface, remembered with it."""
    clouds, memo = settings.clouds, remembering(memo, structure.sha256)
    key = content_key("surface", structure.sha256, clouds)
    return memo("clouds", Cloud, key, lambda: surface_samples(structure, scene_of(structure), clouds))


def skin_of(
    structure: Structure, scene: Scene, cloud: Cloud, clouds: CloudSettings, memo: Memo = no_memo
) -> Skin:
    """The stretches of a structure's skin, remembered with it."""
    key = content_key("skin", structure.sha256, clouds)
    memo = remembering(memo, structure.sha256)
    return memo("skin", Skin, key, lambda: skin_study(structure, scene, cloud))
