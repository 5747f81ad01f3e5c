"""Options and arguments that several commands have, with their help."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from upplied.errors import SettingsError

Cores = Annotated[int, Parameter(help="Number of processes; 0 uses one per core.")]
Point = tuple[float, float, float]
Texts = tuple[str, ...]
AtPoint = Annotated[Point, Parameter(help="X Y Z of the point in metres, in the structure's frame.")]
OnlyStructure = Annotated[str | None, Parameter(help="Only this structure.")]
OnlyKind = Annotated[str | None, Parameter(help="Only structures of this kind.")]
DemonstrationId = Annotated[str, Parameter(help="ID of the demonstration.")]
PersonArgument = Annotated[str, Parameter(help="Name of the person.")]
By = Annotated[str, Parameter(help="Your name, stored with the decision.")]
Note = Annotated[str, Parameter(help="Reason, shown on the page of the plan.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Rules:
    """How strictly imports are checked."""

    allow: Annotated[Texts, Parameter(help="Name of a rule to overrule; repeatable.")] = ()
    strict: Annotated[bool, Parameter(help="Treat warnings as refusals.")] = False
    set_: Annotated[Texts, Parameter(name="--set", help="Limit of a rule, as NAME=VALUE.")] = ()


USUAL = Rules()

PlanId = Annotated[str, Parameter(help="ID of the plan, or its beginning.")]
FindingId = Annotated[str, Parameter(help="ID of the finding, or its beginning.")]
FlightId = Annotated[str, Parameter(help="ID of the flight, or its beginning.")]
StructureId = Annotated[str, Parameter(help="ID of the structure.")]
Owner = Annotated[str, Parameter(help="ID of a structure, or a kind with --kind.")]
OfKind = Annotated[bool, Parameter(help="OWNER is a kind, not a structure.")]
Words = Annotated[str, Parameter(allow_leading_hyphen=False)]
Pairs = Annotated[Texts, Parameter(name="--counterpart")]


@Parameter(name="*")
@dataclass(frozen=True)
class Choices:
    """Planning parameters that differ from the preset.

    Parameters
    ----------
    standoff : str
        Stand-off: scaled with the structure, or unchanged in metres (kept).
    gsd_mm : float
        Required ground sample distance in mm, instead of the stand-off.
    plane : bool
        Keep a planar demonstration in its plane.
    counterpart : tuple of str
        Landmarks that correspond to each other, as SOURCE=TARGET; repeatable.
    repeat : str
        Repeat the demonstration on each similar part, or on the mirrored part too.
    expect : int
        Number of similar parts a target must have; others are refused.
    fidelity : str
        Trade-off between the demonstrated path and coverage: keep the path, balance, or cover more.
    clearance : float
        Minimum distance from the structure, in metres.
    about : str
        Inspected surface, if the inferred one is wrong: landmarks, part_3, or boxes as
        "box X Y Z X Y Z", separated by commas.
    search : str
        Search the orientation of a target: its heading, or all three axes.
    """

    standoff: Literal["scaled", "kept"] | None = None
    gsd_mm: float | None = None
    plane: bool = False
    counterpart: Pairs = ()
    repeat: Literal["each", "mirror"] | None = None
    expect: int | None = None
    fidelity: Literal["strict", "balanced", "coverage"] | None = None
    clearance: float | None = None
    search: Literal["none", "heading", "orientation"] | None = None
    about: str = ""

    def onto(self, stages: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """The changes `stages` (stage -> setting -> value), overridden by the options."""
        chosen = {
            ("transfer", "standoff"): self.standoff,
            ("transfer", "gsd_m"): None if self.gsd_mm is None else self.gsd_mm / 1000,
            ("transfer", "plane"): self.plane or None,
            ("correspondence", "counterparts"): tuple(map(_pair, self.counterpart)) or None,
            ("correspondence", "repeat"): self.repeat,
            ("correspondence", "expect"): self.expect,
            ("refine", "fidelity"): self.fidelity,
            ("route", "clearance_m"): self.clearance,
            ("registration", "search"): self.search,
            ("inspection", "about"): self.about or None,
        }
        merged = {stage: dict(values) for stage, values in stages.items()}
        for (stage, name), value in chosen.items():
            if value is not None:
                merged.setdefault(stage, {})[name] = value
        return merged


def _pair(text: str) -> tuple[str, str]:
    source, equals, target = text.partition("=")
    if not (source and equals and target):
        raise SettingsError(f"--counterpart {text}", "cannot be read", "SOURCE=TARGET, names of landmarks")
    return source, target
