"""How many structures in wrong units, on their sides or of another kind the rules refuse or warn of.

Each structure of the sample fleet, and of the real world where a folder holds them, is judged among all
others of its kind, as it is and with one mistake at a time.

    python bench/structure_rules.py
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from real_data import real_folder, real_structure

from upplied.fleet.admission import shape_of
from upplied.fleet.members import Member, judged
from upplied.inputs.known_kinds import unlike_its_kind
from upplied.inputs.structure_rules import StructureSettings
from upplied.recommend.features import turned
from upplied.samples.fleet import sample_structures

_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_FACTORS = {
    "millimetres as metres": 1000, "inches as metres": 39.37, "feet as metres": 3.2808, "ten times": 10,
    "a model of 3 to 10": 0.3, "a model of 1 to 10": 0.1, "metres as inches": 0.0254,
    "metres as millimetres": 0.001,
}  # fmt: skip


def members() -> Iterator[Member]:
    """Every structure at hand with its shape."""
    for structure in sample_structures():
        yield Member(structure.structure_id, structure.kind, shape_of(structure))
    folder = real_folder()
    for path in sorted((folder / "meshes").glob("[a-z]*/*.ply")) if folder else ():
        structure = real_structure(folder, f"{path.parent.name}/{path.stem}")
        kind = {"airplane": "airliner", "yacht": "ship"}.get(structure.kind, structure.kind)
        yield Member(structure.structure_id, kind, shape_of(structure))


def scaled(factor: float) -> Callable[[Member], Member]:
    """A structure in a wrong unit."""
    return lambda one: replace(one, shape=replace(one.shape, extent_m=one.shape.extent_m * factor))


def on_side(turn: np.ndarray) -> Callable[[Member], Member]:
    """A structure with another axis up."""
    return lambda one: replace(one, shape=turned(one.shape, turn))


def main() -> None:
    """Print the table."""
    every, bounds = list(members()), StructureSettings()
    mistakes: dict[str, Callable[[Member], Member]] = {"right": lambda one: one}
    mistakes |= {name: scaled(factor) for name, factor in _FACTORS.items()}
    mistakes |= {"Y up read as Z up": on_side(_UP), "Z up read as Y up": on_side(_UP.T)}
    mistakes["declared as an airliner"] = lambda one: replace(one, kind="airliner")
    print(f"{len(every)} structures of {len({one.kind for one in every})} kinds")
    print(f"{'':26}{'refused':>9}{'warned':>9}{'taken':>9}")
    for name, change in mistakes.items():
        found: Counter[str] = Counter()
        for one in every:
            if name.startswith("declared") and one.kind == "airliner":
                continue
            new = change(one)
            verdicts = (
                *unlike_its_kind(new.shape.extent_m, new.kind),
                *judged(new, [other for other in every if other is not one], bounds),
            )
            refused = any(verdict.severity == "refuse" for verdict in verdicts)
            found["refused" if refused else "warned" if verdicts else "taken"] += 1
        print(f"{name:26}{found['refused']:9}{found['warned']:9}{found['taken']:9}")


if __name__ == "__main__":
    main()
