"""Families of structures on which nothing was tuned, with flights round them: the same for the same seed.

    python bench/families.py [FAMILY ...]

prints the verdict for one pair of each inspection: the flight round member 0, planned on member 1. With
``bench/stability.py run OUT.jsonl --families`` all pairs are planned. A family's members differ in
proportions, in the number of like parts, and in parts that some lack; all stand on the ground at z = 0.
"""

from __future__ import annotations

import argparse
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from families_lattices import guyed_mast, oil_platform, pylon, tower_crane
from families_pilot import flown
from families_towers import cooling_tower, dish_antenna, lighthouse, statue, water_tower
from families_vehicles import biplane, helicopter, locomotive
from families_works import arch_bridge, church, dam, stadium, stayed_bridge, tanks

from upplied.config import settings_for
from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length
from upplied.planning.plan import plan_transfer
from upplied.records import Demonstration
from upplied.samples.surfaces import Member, Part, assemble

#: Members that are flown, and those that flights are planned on.
SOURCE_SEEDS, TARGET_SEEDS = (0, 4), (1, 2, 3)


@dataclass(frozen=True)
class Inspection:
    """What the names of the inspected parts begin with, and how they are flown: ``round`` or ``along``."""

    parts: tuple[str, ...]
    way: str = "round"


@dataclass(frozen=True)
class Family:
    """How the parts of a member are made, and its inspections by name."""

    parts: Callable[[np.random.Generator], list[Part]]
    inspections: dict[str, Inspection]


FAMILIES = {
    "pylon": Family(pylon, {"arms": Inspection(("arm",)), "body": Inspection(("body",))}),
    "guyed_mast": Family(guyed_mast, {"mast": Inspection(("mast", "panel"))}),
    "stayed_bridge": Family(
        stayed_bridge, {"pylon": Inspection(("pylon_1",)), "deck": Inspection(("deck", "rail"), "along")}
    ),
    "arch_bridge": Family(arch_bridge, {"ribs": Inspection(("rib", "column"), "along")}),
    "tanks": Family(tanks, {"tank": Inspection(("tank_1",)), "farm": Inspection(("tank",))}),
    "church": Family(church, {"tower": Inspection(("tower",)), "nave": Inspection(("nave", "apse"))}),
    "tower_crane": Family(tower_crane, {"mast": Inspection(("mast",)), "jib": Inspection(("jib",), "along")}),
    "helicopter": Family(helicopter, {"body": Inspection(("body", "boom", "cowling"))}),
    "cooling_tower": Family(cooling_tower, {"shell": Inspection(("shell",)), "rim": Inspection(("rim",))}),
    "dish_antenna": Family(dish_antenna, {"dish": Inspection(("dish", "hub", "rib"))}),
    "oil_platform": Family(oil_platform, {"derrick": Inspection(("derrick",)), "legs": Inspection(("leg",))}),
    "locomotive": Family(locomotive, {"body": Inspection(("body",))}),
    "lighthouse": Family(
        lighthouse, {"tower": Inspection(("tower",)), "top": Inspection(("lantern", "cap"))}
    ),
    "dam": Family(
        dam, {"face": Inspection(("block", "base"), "along"), "spillway": Inspection(("spillway",))}
    ),
    "water_tower": Family(water_tower, {"tank": Inspection(("tank",)), "legs": Inspection(("legs",))}),
    "biplane": Family(biplane, {"body": Inspection(("fuselage",)), "wings": Inspection(("wing",))}),
    "statue": Family(
        statue,
        {"figure": Inspection(("figure", "head", "upper", "lower")), "plinth": Inspection(("plinth",))},
    ),
    "stadium": Family(stadium, {"roof": Inspection(("roof",)), "bowl": Inspection(("bowl",), "along")}),
}


@lru_cache(8)
def family_member(family: str, seed: int) -> Member:
    """A member of a family, the same for the same seed."""
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed])
    return assemble(f"{family}-random-{seed}", family, FAMILIES[family].parts(rng), family.replace("_", " "))


def family_flight(family: str, seed: int, inspection: str) -> Demonstration:
    """A flight round a member; RefusedError where there is no room."""
    chosen, name = FAMILIES[family].inspections[inspection], f"{family}-random-{seed}-{inspection}"
    return flown(family_member(family, seed), chosen.parts, chosen.way, name)


def main() -> None:
    """Print the verdict for one pair of each inspection."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "families", nargs="*", metavar="FAMILY", help=f"of {', '.join(FAMILIES)}; all if none"
    )
    parser.add_argument("--target", type=int, default=TARGET_SEEDS[0], metavar="SEED")
    options = parser.parse_args()
    if unknown := set(options.families) - set(FAMILIES):
        raise SystemExit(f"unknown families: {', '.join(sorted(unknown))}; known: {', '.join(FAMILIES)}")
    print(f"{'flight':34}{'m':>5}  {'verdict':9}{'inspected':>10}{'attainable':>11}{'CPU-s':>7}  reason")
    for family in options.families or FAMILIES:
        source, target = (family_member(family, one).structure for one in (SOURCE_SEEDS[0], options.target))
        for inspection in FAMILIES[family].inspections:
            print(f"{family} {inspection:{33 - len(family)}}", end="", flush=True)
            try:
                flight = family_flight(family, SOURCE_SEEDS[0], inspection)
            except RefusedError as refusal:
                print(f"     -  not flown: {refusal}")
                continue
            began = time.process_time()
            plan = plan_transfer(flight, source, target, settings_for("recommended"))
            spent, measures = time.process_time() - began, plan.measures
            length, shown = arc_length(flight.positions)[-1], measures.coverage_inspected_pct
            figures = f"{shown:10.1f}{measures.coverage_attainable_pct:11.1f}{spent:7.1f}"
            print(f"{length:5.0f}  {plan.status:9}{figures}  {plan.reason}", flush=True)


if __name__ == "__main__":
    main()
