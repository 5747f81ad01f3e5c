"""Planning that finds out once what many tests ask about the same structures and flights.

A plan follows from its inputs alone, which `tests/planning/test_plan.py` asks of plans that are made twice.
So tests of one process share what was found out about equal inputs: stages by the memo of the planner, keyed
by the content of the records in place of the hash that they say, and whole plans. Where a test changes the
program under it (`monkeypatch`), or is marked `anew`, everything is computed. Tests of other rooms
share pairs, pictures of pages and places of photos; `tests/conftest.py` says which tests.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from upplied.geometry.scene import Scene
from upplied.planning import plan as planning
from upplied.planning.correspondence import pair
from upplied.planning.correspondence.memo import no_memo

MOST = 400  # stages, plans, pairs and pictures at once

_plan = planning._planned
_store: OrderedDict[tuple[str, str], Any] = OrderedDict()
_functions: dict[tuple[str, str], Callable[..., Any]] = {}
_PROBES = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 3))


def content(*records: Any) -> str:
    """Hash of all fields; equal content may have two, two contents never have one."""
    return hashlib.sha256(pickle.dumps(records)).hexdigest()


def once(stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
    """The memo."""
    if (stage, key) not in _store:
        _store[stage, key] = compute()
        if len(_store) > MOST:
            _store.popitem(last=False)
    _store.move_to_end((stage, key))
    return _store[stage, key]


def named(record):
    """The record with the hash of its content, the same object each time: what follows from it stays."""
    sha256 = content(record)
    return once("record", object, sha256, lambda: replace(record, sha256=sha256))


def study_pair(source, target, settings):
    """A pair of structures, as planning studies it."""
    return pair.study_pair(named(source), named(target), settings, once)


def planned(demonstration, source, target, settings, memo, required, siblings):
    """A plan in the frames of its structures, as `plan_transfer` asks for it."""
    if memo is not no_memo:  # the test brings its own
        return _plan(demonstration, source, target, settings, memo, required, siblings)
    inputs, more = (*map(named, (demonstration, source, target)), settings), (required, tuple(siblings))
    return once("plan", object, content(*inputs, *more), lambda: _plan(*inputs, once, *more))


def photographed(name: str, plan: Any, scene: Scene, *rest: Any) -> str:
    """Key of where photos are taken; scenes are compared by their box and 300 distances."""
    shape = (scene.box, scene.distance(scene.origin + _PROBES * np.ptp(scene.box, axis=0)))
    return content(name, plan, shape, *rest)


#: What tests of all rooms share: a function of a module, and the key of its inputs.
SHARED: tuple[tuple[str, str, Callable[..., str]], ...] = (
    ("upplied.outputs.figures", "thumbnail_png", content),
    ("upplied.outputs.figures", "demonstration_png", content),
    ("upplied.outputs.missions.mission", "shots_of", photographed),
)
#: Where a pair is studied outside of the tests of planning.
STUDIED = ("upplied.planning.plan", "upplied.planning.correspondence.siblings", "upplied.simulate")


def share(anew: bool, but_study: bool) -> None:
    """Pictures are drawn, photos placed and pairs studied once for equal inputs, or each anew."""
    for place, name, key_of in SHARED:
        _replace(place, name, anew, partial(_shared, name, key_of))
    for place in STUDIED:
        _replace(place, "study", anew or but_study, _studied)


def _replace(place: str, name: str, anew: bool, sharing: Callable[..., Any]) -> None:
    if module := sys.modules.get(place):
        original = _functions.setdefault((place, name), getattr(module, name))
        setattr(module, name, original if anew else partial(sharing, original))


def _shared(name: str, key_of: Callable[..., str], function: Callable[..., Any], *arguments: Any) -> Any:
    return once(name, object, key_of(*arguments), partial(function, *arguments))


def _studied(function: Callable[..., Any], source, target, settings, memo=no_memo, siblings=()) -> Any:
    """A pair; the memo is asked for all that it is asked for where the pair is studied anew."""
    calls: list[tuple[str, type, str, Any]] = []

    def noted(stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
        calls.append((stage, record_type, key, memo(stage, record_type, key, compute)))
        return calls[-1][3]

    key = content(source, target, settings, tuple(siblings))
    studied, records = once(
        "study", object, key, lambda: (function(source, target, settings, noted, siblings), calls)
    )
    for stage, record_type, name, record in records if records is not calls else ():
        memo(stage, record_type, name, lambda record=record: record)
    return studied
