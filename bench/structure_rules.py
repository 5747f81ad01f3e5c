"""How many structures in wrong units, on their sides or of another kind the rules refuse or warn of.

Each structure of the sample fleet, and of the real world where a folder holds them, is judged among all
others of its kind, as it is and with one mistake at a time.

    python bench/structure_rules.py
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

from real_data import real_folder, real_structure

from upplied.fleet.admission import shape_of
from upplied.fleet.members import Member, judged
from upplied.inputs.meshes import turn
from upplied.inputs.rules import StructureSettings, unlike_its_kind
from upplied.recommend.shapes import turned
from upplied.samples.fleet import sample_structures

#: By how much too large a structure comes in, and what must be proposed.
_UNITS = {
    "mm as m": (1000, "units = mm"),
    "cm as m": (100, "units = cm"),
    "inches as m": (39.37, "units = in"),
    "feet as m": (3.2808, "units = ft"),
    "m as feet": (0.3048, "units = m"),
    "m as inches": (0.0254, "units = m"),
    "m as cm": (0.01, "units = m"),
    "m as mm, km as m": (0.001, "units = m"),
}
_SIZES = {"ten times": 10, "a model of 3 to 10": 0.3, "a model of 1 to 10": 0.1}
#: Which axis of the file is read as up (and as forward), and what must be proposed.
_AXES = {
    **{f"{up} up read as Z up": (up, "z" if "x" in up else "x", "up") for up in ("x", "-x", "y", "-y", "-z")},
    "heading 180 off": ("z", "-x", "forward"),
    "heading 90 off": ("z", "y", "forward"),
}


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


def standing(up: str, forward: str) -> Callable[[Member], Member]:
    """A structure that stands in its file with these axes up and forward, read as Z up and X forward."""
    return lambda one: replace(one, shape=turned(one.shape, turn(up, forward).T))


def mistakes() -> Iterator[tuple[str, Callable[[Member], Member], str]]:
    """Name, what it makes of a structure, and words of the right proposal; none where none can be right."""
    yield "right", lambda one: one, ""
    for name, (factor, unit) in _UNITS.items():
        yield name, scaled(factor), unit
    for name, factor in _SIZES.items():
        yield name, scaled(factor), ""
    for name, (up, forward, label) in _AXES.items():
        yield name, standing(up, forward), f"{label} = {(up if label == 'up' else forward)!r}"
    yield "declared as an airliner", lambda one: replace(one, kind="airliner"), ""


def main() -> None:
    """Print the table."""
    every, bounds = list(members()), StructureSettings()
    print(f"{len(every)} structures of {len({one.kind for one in every})} kinds")
    print(f"{'':26}{'refused':>9}{'warned':>9}{'taken':>9}{'proposed right':>16}  taken without a word")
    for name, change, words in mistakes():
        counts: Counter[str] = Counter()
        taken = []
        for one in every:
            if name.startswith("declared") and one.kind == "airliner":
                continue
            new = change(one)
            verdicts = (
                *unlike_its_kind(new.shape.extent_m, new.kind),
                *judged(new, [other for other in every if other is not one], bounds),
            )
            refused = any(verdict.severity == "refuse" for verdict in verdicts)
            counts["refused" if refused else "warned" if verdicts else "taken"] += 1
            counts["proposed"] += any(words in f"{verdict} {verdict.remedy}" for verdict in verdicts)
            if not verdicts and name != "right":
                taken.append(one.structure_id)
        proposed = f"{counts['proposed']:16}" if words else f"{'':16}"
        counted = f"{counts['refused']:9}{counts['warned']:9}{counts['taken']:9}{proposed}"
        print(f"{name:26}{counted}  {' '.join(taken)}")


if __name__ == "__main__":
    main()
