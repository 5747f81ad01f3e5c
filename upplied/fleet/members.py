"""A structure against the others of its kind: its size, its unit, the way it stands, and its form.

Shapes are compared by their features (`upplied.recommend.shapes`), free of scale; nothing is registered.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.manifest_keys import UNITS
from upplied.inputs.meshes import turn as file_turn
from upplied.inputs.rules import RULES, StructureSettings, Verdict, broken
from upplied.recommend.shapes import ShapeFeatures, library_of, turned, unlikeness
from upplied.records import Floats

# What a size is off by where one unit is taken for another, and in words.
_CONFUSED = [
    confused
    for name, metres in UNITS.items()
    if metres is not None and metres != 1.0
    for confused in (
        (1 / metres, f"{name} read as m: units = {name}?"),
        (metres, f"metres read as {name}: units = m?"),
    )
]
_TURNS = np.round(Rotation.create_group("O").as_matrix())  # of a cube, (24, 3, 3)
_MIXED = 3.0  # largest over smallest of a kind from which on feet may pass for metres within it
_NEARLY_ALIKE = 0.35  # unlikeness of members of one form, nearly all (airliners, turbines, hulls)


@dataclass(frozen=True)
class Member:
    structure_id: str
    kind: str
    shape: ShapeFeatures
    flown: bool = False  # the source of a demonstration

    @property
    def size_m(self) -> float:
        return float(np.linalg.norm(self.shape.extent_m))

    def __str__(self) -> str:
        return f"{self.structure_id}, {self.size_m:.3g} m" + (", the source of a demonstration" * self.flown)


def judged(
    new: Member,
    others: Sequence[Member],
    bounds: StructureSettings,
    axes: tuple[str, str] = ("z", "x"),
    symmetric: bool = False,
    sized: bool = False,
) -> tuple[Verdict, ...]:
    """The rules that a structure breaks among others of its kind and of other kinds, itself not among them.

    `axes` are the file's declared up and forward; a `symmetric` one has no heading; of a `sized` one the
    size was declared.
    """
    kin = [other for other in others if other.kind == new.kind]
    if not kin:
        return () if sized else (_unconfirmed(new, "it is the first of its kind here"),)
    unlike = unlikeness(new.shape, library_of([one.shape for one in kin]))
    size = tuple(_size(new, kin, unlike, bounds))
    if not size and not sized and not _confirmed(new, kin, unlike, bounds):
        size = (_unconfirmed(new, f"no other {new.kind} here is of its form and its size"),)
    strangers = [other for other in others if other.kind != new.kind]
    stands = _axes(new, kin, float(unlike.min()), bounds, axes, symmetric)
    return (*size, *stands, *_kind(new, kin, unlike, strangers, bounds))


def _size(new: Member, kin: Sequence[Member], unlike: Floats, bounds: StructureSettings) -> Iterator[Verdict]:
    """Larger than all, smaller than all, or off its like by just what two units differ."""
    sizes = np.array([one.size_m for one in kin])
    largest, smallest, like = kin[int(sizes.argmax())], kin[int(sizes.argmin())], kin[int(unlike.argmin())]
    beyond = max(new.size_m / largest.size_m, smallest.size_m / new.size_m, 1.0)
    nearest, side = (largest, "larger") if new.size_m > largest.size_m else (smallest, "smaller")
    unit = _unit(new.size_m / like.size_m, bounds.unit_slack)
    of_form = float(unlike.min()) < bounds.alike
    odd = bounds.odd_size_ratio * (1 + 1 / (3 * len(kin)))
    size = f"its diagonal is {new.size_m:.3g} m, {beyond:.3g} times {side} than every {new.kind} here"
    if beyond > bounds.size_ratio:
        guess = unit or _unit(new.size_m / like.size_m, 2 * bounds.unit_slack)
        middle, span = float(np.sqrt(sizes.min() * sizes.max())), np.log(sizes.max() / sizes.min())
        guess = guess or _unit(new.size_m / middle, np.log(odd) + span / 2)
        looks = f"; looks like {guess}" if guess else ""
        yield broken(RULES["size"], f"{size} ({nearest}){looks}", f"at most {bounds.size_ratio:g} times")
    elif beyond > odd and unit and of_form:
        reason = f"{size} ({nearest}), and {_times(new, like)} as {like.structure_id} of the same form"
        yield broken(RULES["units"], f"{reason}; looks like {unit}")
    elif beyond > odd:
        yield broken(RULES["odd-size"], f"{size} ({nearest})", f"at most {odd:.3g} times")
    elif float(unlike.min()) < _NEARLY_ALIKE and abs(np.log(new.size_m / like.size_m)) > np.log(2):
        yield broken(RULES["odd-size"], f"it is {_times(new, like)} as {like}, which has the same form")


def _confirmed(new: Member, kin: Sequence[Member], unlike: Floats, bounds: StructureSettings) -> bool:
    """Whether another of its kind has its form and size, or all sizes differ by less than two units."""
    sizes = np.array([one.size_m for one in kin])
    if len(kin) > 1 and sizes.max() / sizes.min() < _MIXED:
        return True
    off = np.abs(np.log(new.size_m / sizes))
    return bool(((unlike < bounds.alike) & (off < np.log(bounds.odd_size_ratio))).any())


def _unconfirmed(new: Member, why: str) -> Verdict:
    longest = float(new.shape.extent_m.max())
    return broken(RULES["size-unconfirmed"], f"{longest:.3g} m long is what its file and manifest say: {why}")


def _times(new: Member, like: Member) -> str:
    ratio = new.size_m / like.size_m
    return f"{ratio:.2g} times as large" if ratio > 1 else f"{1 / ratio:.2g} times as small"


def _unit(ratio: float, slack: float) -> str:
    """Which confusion of units explains a ratio of sizes, in words; empty where none does."""
    off = [abs(np.log(ratio / factor)) for factor, _ in _CONFUSED]
    best = int(np.argmin(off))
    return _CONFUSED[best][1] if off[best] < slack and abs(np.log(ratio)) > np.log(2) else ""


def _axes(
    new: Member,
    kin: Sequence[Member],
    declared: float,
    bounds: StructureSettings,
    axes: tuple[str, str],
    symmetric: bool,
) -> Iterator[Verdict]:
    library = library_of([one.shape for one in kin])
    nearest_turn = [float(unlikeness(turned(new.shape, turn), library).min()) for turn in _TURNS]
    stands = _TURNS[:, 2, 2] > 0.5
    headings = [] if symmetric else np.flatnonzero(stands).tolist()
    for rule, tried in (("up-axis", np.flatnonzero(~stands).tolist()), ("forward-axis", headings)):
        best = min(tried, key=nearest_turn.__getitem__, default=None)
        if best is None or nearest_turn[best] >= min(bounds.alike, bounds.turned_share * declared):
            continue
        right = _TURNS[best] @ file_turn(*axes)
        names = [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in right[[2, 0]]]
        words = (
            f"as declared (up {axes[0]}, forward {axes[1]}) its form misses that of every {new.kind} here by"
            f" {declared:.2f}, with up = {names[0]!r} and forward = {names[1]!r} by {nearest_turn[best]:.2f}"
        )
        remedy = f"declare up = {names[0]!r} and forward = {names[1]!r} if that is so"
        if rule == "up-axis" and declared < bounds.alike:
            rule = "odd-up-axis"
        yield broken(RULES[rule], words, f"{bounds.turned_share:g} of it", remedy)
        return


def _kind(
    new: Member, kin: Sequence[Member], unlike: Floats, others: Sequence[Member], bounds: StructureSettings
) -> Iterator[Verdict]:
    best = float(unlike.min())
    elsewhere = unlikeness(new.shape, library_of([one.shape for one in others])) if others else np.array([])
    if len(elsewhere) and elsewhere.min() < min(bounds.alike, bounds.other_kind_share * best):
        other = others[int(elsewhere.argmin())]
        if best > bounds.alike:
            words = f"its form is that of a {other.kind} ({other.structure_id}) rather than of a {new.kind}"
            yield broken(RULES["kind"], f"{words}: unlikeness {elsewhere.min():.2f} instead of {best:.2f}")
            return
    # Where the others of the kind are as unlike each other, nothing is said by that.
    between = [float(unlikeness(a.shape, library_of([b.shape for b in kin if b is not a])).min())
               for a in kin] if len(kin) > 1 else [0.0]  # fmt: skip
    if best > max(bounds.odd_unlikeness, 1.2 * float(np.median(between))):
        most_alike = f"the most alike ({kin[int(unlike.argmin())].structure_id}) misses by {best:.2f}"
        words = f"its form is unlike every other {new.kind} here, {most_alike}"
        yield broken(RULES["kind"], words, f"at most {bounds.odd_unlikeness:g}")
