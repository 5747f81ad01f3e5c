"""Which pairs of structures are taken for the same kind: the confusion table of the acceptance measure.

    python bench/acceptance.py [--both] [--samples] [--list]

Every pair of the real structures (see bench/real_data.py) is judged as `recommended` does; with
``--both`` in both directions, with ``--samples`` the parametric fleet as well. `same` are pairs that
were looked at and are of one form (`FORMS`); `cross` are pairs of different kinds; what is left, of
one kind and another form (a high wing among low ones, a yacht and a liner), is counted apart.
The last lines calibrate the gate on a random half of the structures and report the other half, and
on all structures but one, in turn, and report the pairs of that one.
"""

from __future__ import annotations

import argparse
import csv
import time
from itertools import combinations

import numpy as np
from real_data import real_folder, real_structure

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.registration import fitted
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud, Structure
from upplied.samples.fleet import sample_structures

FORMS = {
    "low-wing airliner": "a320_fgstatic_united a320_fr24 a321_fr24 a333_fr24 b738_fr24 b744_fr24 b772_fr24 "
    "b788_fr24 beluga_fr24 e190_fr24 md11_fgstatic a320-v1 beluga-v1 b747-v1 b777-v1",
    "three-blade turbine": "enercon_e82_78m enercon_e82_98m vestas_v112_119m vestas_v90_105m "
    "turbine-1-v1 turbine-2-v1 turbine-3-v1",
    "passenger ship": "cruise_ship_219m silver_shadow_187m ferry_88m",
    "sample ship": "cruise-v1 yacht-1-v1 yacht-2-v1",
    "cooling tower": "cooling_tower_131m cooling_tower_42m",
    "plain box": "generic_135x65x35_fg office_30x47_fg cube-v1 cuboid-v1",
    "two-tower suspension bridge": "larics_bridge suspension_aerostack",
    "beam bridge": "bridge-1-v1 bridge-2-v1",
}
KINDS = {
    "airliner": "airplane",
    "yacht": "ship",
    "box": "building",
    "cooling_tower_131m": "cooling tower",
    "cooling_tower_42m": "cooling tower",
    "transmission_steel_24m": "pylon",
    "transmission_tower_40m": "pylon",
    "water_tower_51m": "water tower",
}
_TRUTHS = ("same", "one kind, other form", "cross")
_HALVES = 200
_LET_THROUGH = 0.007  # share of the cross pairs by which the gate is calibrated


def main() -> None:
    """Print the table, the gate's calibration and, if asked, every pair that is judged wrongly."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--both", action="store_true", help="both directions of every pair")
    parser.add_argument("--samples", action="store_true", help="the parametric fleet as well")
    parser.add_argument("--list", action="store_true", help="name every pair that is judged wrongly")
    options = parser.parse_args()
    structures = [*_real(), *(sample_structures() if options.samples else [])]
    if not structures:
        raise SystemExit("no real structures found (UPPLIED_REAL_DATA); try --samples")
    clouds = [surface_samples(one, scene_of(one), settings_for("recommended").clouds) for one in structures]
    began = time.process_time()
    rows = _judged(structures, clouds, options.both)
    seconds = time.process_time() - began
    gate = settings_for("recommended").registration.acceptance
    _print_table(rows, gate)
    print(f"\n{len(rows)} pairs, {1e3 * seconds / len(rows):.0f} CPU ms a pair")
    _print_halves(structures, rows)
    if options.list:
        _print_wrong(rows, gate)


def _real() -> list[Structure]:
    folder = real_folder()
    if folder is None:
        return []
    with open(folder / "meshes" / "MANIFEST.csv", newline="") as file:
        return [real_structure(folder, f"{row['kind']}/{row['name']}") for row in csv.DictReader(file)]


def _judged(
    structures: list[Structure], clouds: list[Cloud], both: bool
) -> list[tuple[int, int, str, float]]:
    """Source, target, truth and misfit of each pair."""
    gate = settings_for("recommended").registration.acceptance
    rows = []
    for one, other in combinations(range(len(structures)), 2):
        ways = (
            ((one, other), (other, one)) if both else ((one, other) if (one + other) % 2 else (other, one),)
        )
        for source, target in ways:
            registration = fitted(clouds[source], clouds[target], gate)
            rows.append(
                (source, target, truth_of(structures[source], structures[target]), registration.acceptance)
            )
    return rows


def truth_of(one: Structure, other: Structure) -> str:
    """What a person who looked at both says."""
    forms = [
        next((form for form, ids in FORMS.items() if s.structure_id in ids.split()), "") for s in (one, other)
    ]
    if forms[0] and forms[0] == forms[1]:
        return "same"
    kinds = [KINDS.get(s.structure_id) or KINDS.get(s.kind, s.kind) for s in (one, other)]
    return "one kind, other form" if kinds[0] == kinds[1] else "cross"


def _print_table(rows: list[tuple[int, int, str, float]], gate: float) -> None:
    print(f"{'truth':24}{'pairs':>8}{'accepted':>10}{'refused':>9}{'accepted %':>12}")
    for truth in _TRUTHS:
        values = np.array([value for _, _, label, value in rows if label == truth])
        accepted = int((values < gate).sum())
        share = 100 * accepted / max(len(values), 1)
        print(f"{truth:24}{len(values):8d}{accepted:10d}{len(values) - accepted:9d}{share:12.1f}")


def _print_halves(structures: list[Structure], rows: list[tuple[int, int, str, float]]) -> None:
    """Gates that let few cross pairs of some structures through, and what they do on the others."""
    source, target = np.array([row[:2] for row in rows]).T
    truth, value = np.array([row[2] for row in rows]), np.array([row[3] for row in rows])
    rng, rows_drawn = np.random.default_rng(0), []
    for _ in range(_HALVES):
        half = rng.random(len(structures)) < 0.5
        mine, theirs = half[source] & half[target], ~half[source] & ~half[target]
        if (
            min(
                np.count_nonzero(part & (truth == label))
                for part in (mine, theirs)
                for label in ("same", "cross")
            )
            < 8
        ):
            continue
        gate = np.quantile(value[mine & (truth == "cross")], _LET_THROUGH)
        shares = [100 * np.mean(value[theirs & (truth == label)] < gate) for label in ("same", "cross")]
        rows_drawn.append((gate, *shares))
    gates = np.array(rows_drawn)
    print(
        f"calibrated on half of the structures, {len(gates)} times: gate {gates[:, 0].mean():.2f} "
        f"(+- {gates[:, 0].std():.2f}); on the other half {gates[:, 1].mean():.1f} % of the same "
        f"and {gates[:, 2].mean():.1f} % of the cross pairs are accepted"
    )
    shares = _left_out(source, target, truth, value)
    print(
        f"calibrated without each structure: {shares[0]:.1f} % of the same and {shares[1]:.1f} % of the "
        "cross pairs of the one left out are accepted"
    )


def _left_out(source: np.ndarray, target: np.ndarray, truth: np.ndarray, value: np.ndarray) -> list[float]:
    accepted, judged = np.zeros(2), np.zeros(2)
    for one in np.unique(np.concatenate([source, target])):
        its = (source == one) | (target == one)
        gate = np.quantile(value[~its & (truth == "cross")], _LET_THROUGH)
        for column, label in enumerate(("same", "cross")):
            values_of = value[its & (truth == label)]
            accepted[column] += np.count_nonzero(values_of < gate)
            judged[column] += len(values_of)
    return (100 * accepted / np.maximum(judged, 1)).tolist()


def _print_wrong(rows: list[tuple[int, int, str, float]], gate: float) -> None:
    structures = [*_real(), *sample_structures()]
    for source, target, truth, value in sorted(rows, key=lambda row: row[3]):
        if (truth == "same" and value >= gate) or (truth == "cross" and value < gate):
            names = f"{structures[source].structure_id} > {structures[target].structure_id}"
            print(f"{truth:8}{value:8.2f}  {names}")


if __name__ == "__main__":
    main()
