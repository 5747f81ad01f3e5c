"""What has to be planned, and why: the pairs whose inputs the catalog has no plan for.

A plan is named by the hash of all that it depends on (`planning.plan.transfer_key`); the rest only says
what changed.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress, count
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import is_foreign, transfer_id
from upplied.catalog.schema.rows import json_text
from upplied.catalog.verbs import belonging
from upplied.checks import check_id, suggested
from upplied.config import Settings, digest, settings_for
from upplied.errors import InputError
from upplied.planning.correspondence.memo import METHOD_VERSION
from upplied.provenance import causes
from upplied.records import Demonstration, Structure

Siblings = tuple[tuple[str, str], ...]  # id and hash of each

_SIZE = ["size_x_m", "size_y_m", "size_z_m"]


class SiblingsOf:
    """The siblings of structures; of those nobody asked, a cloud is a scan and a mesh may know its parts."""

    def __init__(self, structures: pd.DataFrame) -> None:
        table = structures.sort_values("structure_id")
        labelled = table["tells_parts"].astype("boolean")
        mesh = table["n_triangles"] > 0
        scans = table[~labelled.fillna(mesh)]
        self._scans = dict(zip(scans["structure_id"], scans["kind"], strict=True))
        self._sha256 = dict(zip(table["structure_id"], table["sha256"], strict=True))
        self._size = dict(zip(table["structure_id"], table[_SIZE].to_numpy(float), strict=True))
        known = table[mesh & labelled.fillna(True)].groupby("kind")
        self._known = {
            str(kind): (list(rows["structure_id"]), rows[_SIZE].to_numpy(float)) for kind, rows in known
        }
        self._nearest: dict[tuple[str, int], tuple[str, ...]] = {}

    def __call__(self, source_id: str, target_id: str, most: int) -> Siblings:
        """At most so many siblings of a target, by their ids; none where its own pieces tell its parts."""
        if most < 1 or target_id not in self._scans:
            return ()
        if (target_id, most) not in self._nearest:
            known = self._known.get(self._scans[target_id], ([], np.empty((0, 3))))
            from upplied.planning.correspondence.siblings import nearest_in_proportions

            # One more, since the source may be among them.
            nearest = nearest_in_proportions(self._size[target_id], *known, most + 1)
            self._nearest[target_id, most] = nearest
        chosen = [name for name in self._nearest[target_id, most] if name != source_id][:most]
        return tuple((name, self._sha256[name]) for name in sorted(chosen))


@dataclass(frozen=True)
class PlanRequest:
    """Which plans the fleet should have; empty tuples mean every one."""

    presets: tuple[str, ...] = ("recommended", "baseline")
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # stage -> setting -> value
    demonstrations: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    retry_failed: bool = False
    experiment: str = ""  # its name: what is planned for it never becomes current

    @property
    def purpose(self) -> str:
        return f"experiment {check_id(self.experiment, 'experiment')}" if self.experiment else ""


class SettingsOf:
    """The settings that a run plans each structure with: the preset's, its kind's, its own, the run's."""

    def __init__(self, catalog: Catalog, plan_request: PlanRequest) -> None:
        self._declared = belonging.declared(catalog)
        self._zones = belonging.Zones(catalog)
        self._changes = plan_request.changes
        self._known_settings: dict[tuple[str, str, str], Settings] = {}

    def __call__(self, preset: str, kind: str, structure_id: str) -> Settings:
        """For one structure; many share one record, since its hash is asked for again and again."""
        alone = ("structure", structure_id) in self._declared or self._zones.owned(structure_id)
        own = structure_id if alone else ""
        if (preset, kind, own) not in self._known_settings:
            changes = belonging.changes_for(self._declared, preset, kind, structure_id, self._changes)
            if preset == belonging.FLOWN and (zones := self._zones.named(kind, structure_id)):
                changes["required"] = {"zones": zones}
            self._known_settings[preset, kind, own] = settings_for(preset, **changes)
        return self._known_settings[preset, kind, own]


@dataclass(frozen=True, slots=True)
class Job:
    demonstration_id: str
    source_id: str
    target_id: str
    kind: str
    settings: Settings
    key: str
    why: str
    sha256: tuple[str, str, str]  # of the demonstration, the source and the target
    purpose: str = ""  # as in `transfers`
    siblings: Siblings = ()  # that are asked for the parts of a scan

    def __str__(self) -> str:
        return f"{self.demonstration_id} to {self.target_id} ({self.settings.preset})"


@dataclass(frozen=True)
class Decision:
    jobs: list[Job]
    unchanged: int

    @property
    def reasons(self) -> dict[str, int]:
        counted = Counter(job.why for job in self.jobs)
        return dict(sorted(counted.items(), key=lambda item: (-item[1], item[0])))


def decide(catalog: Catalog, plan_request: PlanRequest | None = None) -> Decision:
    """Which plans are missing: demonstrations to all other structures of their kind, or to the named targets.

    Raises
    ------
    InputError
        If the plan_request names what the catalog does not hold, or a target of another kind.
    """
    plan_request = plan_request or PlanRequest()
    table = catalog.structures()
    structures, siblings_of = _structures(table), SiblingsOf(table)
    demonstrations = _demonstrations(catalog)
    _check_known("demonstration", plan_request.demonstrations, demonstrations)
    _check_known("structure", plan_request.targets, structures)
    _check_kinds(plan_request, demonstrations, structures)
    settings_of = SettingsOf(catalog, plan_request)

    def candidates() -> Iterator[Candidate]:
        for preset in plan_request.presets:
            for flown, source, target in _pairs(demonstrations, structures, plan_request):
                settings = settings_of(preset, target.kind, target.structure_id)
                most = settings.correspondence.siblings
                siblings = siblings_of(source.structure_id, target.structure_id, most)
                yield flown, source, target, settings, siblings

    from upplied.planning.plan import transfer_key  # planning itself, which questions never load

    # A large fleet has a million keys and few of them to plan: they are kept as one array. A plan that is
    # made for a purpose of its own is another plan, so that none stands for both.
    purpose = plan_request.purpose
    names = (transfer_key(*candidate) for candidate in candidates())
    keys = pa.array((digest([name, purpose]) if purpose else name for name in names), pa.string())
    missing = catalog.unsettled(keys, retry_failed=plan_request.retry_failed)
    past, jobs = Past(catalog), []
    for candidate, place in compress(zip(candidates(), count()), missing):
        flown, source, target, settings, siblings = candidate
        key = keys[place].as_py()
        ids = (flown.demonstration_id, source.structure_id, target.structure_id)
        hashes = (flown.sha256, source.sha256, target.sha256)
        why = past.why(candidate, key)
        jobs.append(Job(*ids, target.kind, settings, key, why, hashes, purpose, siblings))
    jobs.sort(key=lambda job: (job.demonstration_id, job.target_id, job.settings.preset))
    return Decision(jobs, len(keys) - len(jobs))


def _pairs(
    demonstrations: Mapping[str, Demonstration], structures: Mapping[str, Structure], request: PlanRequest
) -> Iterator[tuple[Demonstration, Structure, Structure]]:
    for demonstration_id in request.demonstrations or demonstrations:
        demonstration = demonstrations[demonstration_id]
        source = structures.get(demonstration.structure_id)
        if source is None:
            if request.demonstrations:
                fault = f"was flown on {demonstration.structure_id}, which the catalog does not hold"
                raise InputError(f"demonstration {demonstration_id}", fault, "", "add that structure first")
            continue
        for target_id in request.targets or structures:
            target = structures[target_id]
            if target.kind == source.kind and (target is not source or request.targets):
                yield demonstration, source, target


def _check_known(what: str, names: tuple[str, ...], known: Mapping[str, object]) -> None:
    for name in names:
        if name not in known:
            raise InputError(f"{what} {name!r}", "is not in the catalog", suggested(name, known))


def _check_kinds(
    request: PlanRequest, demonstrations: Mapping[str, Demonstration], structures: Mapping[str, Structure]
) -> None:
    """A target of a kind that nothing was flown on would be passed over in silence."""
    sources = [demonstrations[name].structure_id for name in request.demonstrations or demonstrations]
    flown = {structures[name].kind for name in sources if name in structures}
    for name in request.targets:
        if structures[name].kind not in flown:
            fault = f"is of kind {structures[name].kind}, flown was {' and '.join(sorted(flown)) or 'none'}"
            rule = "a demonstration is carried to structures of its own kind"
            raise InputError(f"structure {name!r}", fault, rule)


def _structures(table: pd.DataFrame) -> dict[str, Structure]:
    """The structures by id, without their shapes: their hashes are all that is compared."""
    nothing = np.empty((0, 3)), np.empty((0, 3), np.int64)
    rows = table[["structure_id", "kind", "sha256"]].itertuples(index=False)
    return {name: Structure(name, kind, *nothing, sha256=sha256) for name, kind, sha256 in rows}


def _demonstrations(catalog: Catalog) -> dict[str, Demonstration]:
    nothing = np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 4))
    rows = catalog.demonstrations()[["demonstration_id", "structure_id", "sha256"]].itertuples(index=False)
    return {name: Demonstration(name, place, *nothing, sha256=sha256) for name, place, sha256 in rows}


Candidate = tuple[Demonstration, Structure, Structure, Settings, Siblings]


class Past:
    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._known: dict[tuple[str, ...], tuple[str, ...]] = {}  # causes by what rows say of the program

    @cached_property
    def _rows(self) -> pa.Table:
        """The newest plan of each demonstration, target and preset; a quiet night never asks."""
        columns = [*_SLOT, *_CHANGES.values(), *_PROGRAM, "imported_from"]
        return self._catalog.newest_plans(columns).combine_chunks()

    @cached_property
    def _places(self) -> dict[tuple[str, ...], int]:
        encoded = [self._rows[name].combine_chunks() for name in _SLOT]
        texts = (map(each.dictionary.to_pylist().__getitem__, each.indices.to_numpy()) for each in encoded)
        return {name: place for place, name in enumerate(zip(*texts, strict=True))}

    def why(self, candidate: Candidate, key: str) -> str:
        demonstration, source, target, settings, siblings = candidate
        place = self._places.get((demonstration.demonstration_id, target.structure_id, settings.preset))
        if place is None:
            return "new pair"
        # Texts are missing in rows of before there was such a column.
        before = {name: self._rows[name][place].as_py() or "" for name in self._rows.column_names}
        if before["transfer_id"] == transfer_id(key):
            return "imported, not measured here" if is_foreign(before) else "failed before"
        others = json_text([list(one) for one in siblings]) if siblings else ""
        now = (demonstration.sha256, source.sha256, target.sha256, settings.sha256, others)
        compared = zip(_CHANGES.items(), now, strict=True)
        changes = [f"{what} changed" for (what, name), value in compared if before[name] != value]
        program = tuple(before[name] for name in _PROGRAM)
        if program not in self._known:  # few rows differ in it; another machine plans the same
            self._known[program] = tuple(causes(dict(zip(_PROGRAM, program, strict=True)), METHOD_VERSION))
        return ", ".join([*changes, *self._known[program]]) or "an older version is back"


_CHANGES = {name: f"{name}_sha256" for name in ("demonstration", "source", "target", "settings")}
_CHANGES["siblings"] = "siblings"
_PROGRAM = ("method_version", "code_version", "sources_sha256", "libraries")
_SLOT = ("demonstration_id", "target_id", "preset")
