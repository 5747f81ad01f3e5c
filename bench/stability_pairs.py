"""Pairs of a flight and a structure to plan: of like kinds and strangers, real and generated.

Real structures are those of the folders `meshes` and `meshes2` (bench/real_data.py), flown round by the logs
of `flights2` and by the simulated pilot; generated ones are of seeds that nothing was tuned on, or of
families (bench/families.py) that nothing was. Like kind is like declared kind, where yachts are ships and
boxes are buildings. A pair belongs to half ``tune`` or ``report`` by a hash of its TARGET's name; flights are
shared by both halves.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from families import FAMILIES, family_flight, family_member
from families import SOURCE_SEEDS as FLOWN_MEMBERS
from families import TARGET_SEEDS as TARGET_MEMBERS
from random_members import random_member
from real_data import real_folder

from upplied.inputs.logs import read_demonstration
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.records import Demonstration, Structure, Surroundings
from upplied.samples.pilot import fly

GROUPS = {
    "airplane": "airplane", "airliner": "airplane", "wind_turbine": "turbine", "ship": "ship",
    "yacht": "ship", "building": "building", "box": "building", "bridge": "bridge",
    "industrial": "industrial",
}  # fmt: skip
#: The part that an inspection, or the name of a log, is about.
PARTS = {
    "fuselage": "fuselage", "wings": "wings", "engine_left": "engine", "engine": "engine",
    "engineout": "engine", "tower": "tower", "hull": "hull", "sides": "sides", "piers": "piers",
}  # fmt: skip
#: Flights of the simulated pilot round real structures.
PILOT = {
    "a320_fr24": ("fuselage", "wings", "engine_left"),
    "b744_fr24": ("fuselage", "wings", "engine_left"),
    "b738_fr24": ("fuselage", "wings", "engine_left"),
    "e190_fr24": ("wings", "engine_left"),
    "md11_fgstatic": ("wings", "engine_left"),
    "enercon_e82_98m": ("tower",),
    "vestas_v90_105m": ("tower",),
    "cruise_ship_219m": ("hull",),
    "ferry_88m": ("hull",),
    "office_30x47_fg": ("sides",),
    "hotel_generic_fg": ("sides",),
    "larics_bridge": ("piers",),
}
#: Flights round generated structures, and round real ones of their groups that nothing else flies.
GENERATED = {
    "airliner": ("fuselage", "wings", "engine_left"),
    "wind_turbine": ("tower",),
    "ship": ("hull",),
    "box": ("sides",),
    "bridge": ("piers",),
}
SOURCE_SEEDS, TARGET_SEEDS = range(9000, 9003), range(9100, 9106)


@dataclass(frozen=True)
class Flight:
    """A demonstration that can be made, and the structure that it was flown round."""

    name: str
    source: str
    part: str
    group: str
    inspection: str = ""  # of the simulated pilot; empty: a log


@dataclass(frozen=True)
class Pair:
    """A flight and the structure that it is to be planned on."""

    flight: Flight
    target: str
    stranger: bool

    @property
    def name(self) -> str:
        """``flight > target``."""
        return f"{self.flight.name} > {self.target}"

    @property
    def generated(self) -> bool:
        """Whether both structures are generated."""
        return "-random-" in self.flight.source and "-random-" in self.target

    @property
    def half(self) -> str:
        """``tune`` or ``report``, by a hash of the target's name."""
        return "report" if hashlib.sha256(self.target.encode()).digest()[0] % 2 else "tune"


@cache
def meshes() -> dict[str, Path]:
    """The files of the real structures, by name."""
    folder = real_folder()
    if folder is None:
        return {}
    paths = [path for some in ("meshes", "meshes2") for path in sorted((folder / some).glob("[a-z]*/*.ply"))]
    return {path.stem: path for path in paths}


@cache
def groups() -> dict[str, str]:
    """The group of like kind of each structure."""
    kinds = {name: GROUPS[path.parent.name] for name, path in meshes().items()}
    for kind in GENERATED:
        for seed in (*SOURCE_SEEDS, *TARGET_SEEDS):
            kinds[f"{kind}-random-{seed}"] = GROUPS[kind]
    return kinds


@lru_cache(12)
def structure(name: str) -> Structure:
    """A structure by its name, of its group's kind: metres, Z up, the ground at z = 0 of the real ones."""
    if "-random-" in name:
        kind, _, seed = name.partition("-random-")
        if kind in FAMILIES:
            return family_member(kind, int(seed)).structure
        return replace(random_member(kind, int(seed)).structure, kind=GROUPS[kind])
    path = meshes()[name]
    kind, ground = GROUPS[path.parent.name], Surroundings(ground_z_m=0.0)
    return read_structure(StructureEntry(name, kind, path, unit_m=1.0, surroundings=ground))


@cache
def flights(unflown: bool = False) -> list[Flight]:
    """The logs, and what the simulated pilot is to fly; or only round the real structures not among these."""
    if unflown:
        flown = {flight.source for flight in flights()}
        return [
            Flight(f"{source}-{PARTS[one]}", source, PARTS[one], GROUPS[kind], one)
            for source in meshes()
            for kind, some in GENERATED.items()
            for one in some
            if groups()[source] == GROUPS[kind] and source not in flown
        ]
    flights_of = []
    folder = real_folder()
    for path in sorted((folder / "flights2").glob("*.mcap")) if folder else []:
        source = logged(path.stem).structure_id
        flights_of.append(Flight(path.stem, source, PARTS[path.stem.rpartition("-")[2]], groups()[source]))
    pilot = {name: some for name, some in PILOT.items() if name in meshes()}
    for kind, some in GENERATED.items():
        pilot |= {f"{kind}-random-{seed}": some for seed in SOURCE_SEEDS}
    for source, some in pilot.items():
        flights_of += [
            Flight(f"{source}-{PARTS[one]}", source, PARTS[one], groups()[source], one) for one in some
        ]
    return flights_of


@cache
def logged(name: str) -> Demonstration:
    """A flight of the logs."""
    folder = real_folder()
    assert folder is not None
    return read_demonstration(folder / "flights2" / f"{name}.mcap")


@lru_cache(12)
def demonstration(flight: Flight) -> Demonstration:
    """The flight itself; the pilot raises RefusedError where there is no room."""
    if not flight.inspection:
        return logged(flight.name)
    if flight.group in FAMILIES:
        return family_flight(flight.group, int(flight.source.rpartition("-")[2]), flight.inspection)
    return fly(structure(flight.source), flight.inspection, seed=len(flight.inspection))


def _candidates(strangers: bool, unflown: bool = False) -> Iterator[Pair]:
    for flight in flights(unflown):
        for target, group in groups().items():
            like = group == flight.group
            if like == strangers or target == flight.source:
                continue
            # Generated ones are flown to generated ones of other seeds, and to strangers of any sort.
            if not strangers and ("-random-" in flight.source) != ("-random-" in target):
                continue
            if "-random-" in target and int(target.rpartition("-")[2]) not in TARGET_SEEDS:
                continue
            yield Pair(flight, target, strangers)


def _family_candidates(strangers: bool) -> Iterator[Pair]:
    """Flights of families, whose part is the family's name, on members of the same or of other families."""
    targets = [(name, f"{name}-random-{seed}") for name in FAMILIES for seed in TARGET_MEMBERS]
    for name, family in FAMILIES.items():
        for source in (f"{name}-random-{seed}" for seed in FLOWN_MEMBERS):
            for inspection in family.inspections:
                flight = Flight(f"{source}-{inspection}", source, name, name, inspection)
                yield from (Pair(flight, one, strangers) for of, one in targets if (of != name) == strangers)


def pairs(
    strangers: bool = False, seed: int = 0, families: bool = False, unflown: bool = False
) -> list[Pair]:
    """All pairs, or those of the families, in an order of which every beginning is a fair sample.

    With `unflown` they are of flights round the real structures that no other pair's flight is round.

    Parts take turns (engine, fuselage, wings, ...); within a part real and generated pairs and both
    halves come in proportion to their numbers, shuffled.
    """
    strata: dict[tuple[str, bool, str], list[Pair]] = {}
    for pair in _family_candidates(strangers) if families else _candidates(strangers, unflown):
        strata.setdefault((pair.flight.part, pair.generated, pair.half), []).append(pair)
    placed: dict[str, list[tuple[float, Pair]]] = {}
    for number, (key, some) in enumerate(sorted(strata.items())):
        rng = np.random.default_rng([seed, number])
        for place, index in enumerate(rng.permutation(len(some))):
            share = (place + rng.random()) / len(some)
            placed.setdefault(key[0], []).append((share, some[index]))
    turns = []
    for part, places in placed.items():
        places.sort(key=lambda one: one[0])
        turns += [(turn, part, pair) for turn, (_, pair) in enumerate(places)]
    return [pair for _, _, pair in sorted(turns, key=lambda one: one[:2])]
