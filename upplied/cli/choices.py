"""What a person may decide about transfers, as options with names of their own; `--set` reaches the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from cyclopts import Parameter

Pairs = Annotated[tuple[str, ...], Parameter(name="--counterpart", negative="", show_default=False)]


@Parameter(name="*")
@dataclass(frozen=True)
class Choices:
    """Settings that differ from those of the presets.

    Parameters
    ----------
    standoff : str
        Distance to the surface: scaled with the structure, or as the demonstrated millimetres a pixel ask.
    gsd : float
        Size of a pixel on the surface, m, to keep instead of the demonstrated distance.
    plane : bool
        A demonstration in a plane stays in its plane.
    counterpart : tuple of str
        Landmarks that correspond to each other, as SOURCE=TARGET; repeatable.
    repeat : str
        Fly what was demonstrated on one part on each part of its kind, or on its mirror image too.
    expect : int
        How many parts like the inspected one a target must have; one with another number is refused.
    fidelity : str
        How much of the demonstrated shape may go for showing more: none to speak of, some, or much.
    clearance : float
        Least distance from the structure, m.
    about : str
        What the flight inspected, where that is not what was inferred: landmarks, part_3, or boxes as
        "box X Y Z X Y Z", separated by commas.
    search : str
        Find how a target is turned, about the vertical or altogether.
    """

    standoff: Literal["scaled", "kept"] | None = None
    gsd: float | None = None
    plane: Annotated[bool, Parameter(negative="", show_default=False)] = False
    counterpart: Pairs = ()
    repeat: Literal["each", "mirror"] | None = None
    expect: int | None = None
    fidelity: Literal["strict", "balanced", "coverage"] | None = None
    clearance: float | None = None
    search: Literal["none", "heading", "orientation"] | None = None
    about: Annotated[str, Parameter(show_default=False)] = ""

    def onto(self, stages: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """The changes `stages` (stage -> setting -> value) with those of the options over them."""
        chosen = {
            ("transfer", "standoff"): self.standoff,
            ("transfer", "gsd_m"): self.gsd,
            ("transfer", "plane"): self.plane or None,
            ("correspondence", "counterparts"): tuple(map(_pair, self.counterpart)) or None,
            ("correspondence", "repeat"): self.repeat,
            ("correspondence", "expect"): self.expect,
            ("refine", "fidelity"): self.fidelity,
            ("route", "clearance_m"): self.clearance,
            ("registration", "search"): self.search,
            ("inspection", "about"): self.about or None,
        }
        made = {stage: dict(values) for stage, values in stages.items()}
        for (stage, name), value in chosen.items():
            if value is not None:
                made.setdefault(stage, {})[name] = value
        return made


def _pair(text: str) -> tuple[str, str]:
    from upplied.errors import SettingsError

    source, equals, target = text.partition("=")
    if not (source and equals and target):
        raise SettingsError(f"--counterpart {text}", "cannot be read", "SOURCE=TARGET, names of landmarks")
    return source, target
