"""Meshes of airliners, gear up, at their height on the gear; four of them are in `shapes.toml`.

The structure frame has its origin on the ground below the middle of the length, +X to the nose and
+Y to the left wing. Lengths of a shape count from the nose aft along the fuselage and up from the ground. The
dimensions are those the makers publish for airport planning (length, span, height, fuselage, engine
positions); chords and fillets in between are drawn to match them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from upplied.records import Floats
from upplied.samples.surfaces import Member, Part, Section, assemble, foil_loft, loft, revolve, superellipse

_UP, _ACROSS = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
_AROUND = 36  # points of a section of the fuselage
# Distance aft and radius, as shares of the length and of the largest radius: from the tip of the spinner over
# fan, intake, lip, cowl, fan nozzle and core nozzle to the tip of the plug.
_COWL = np.array(
    [
        (0.13, 0.0), (0.16, 0.12), (0.21, 0.25), (0.22, 0.52), (0.22, 0.80), (0.11, 0.80), (0.03, 0.80),
        (0.005, 0.83), (0.0, 0.87), (0.01, 0.905), (0.05, 0.95), (0.14, 0.99), (0.28, 1.0), (0.45, 0.98),
        (0.60, 0.90), (0.72, 0.78), (0.725, 0.58), (0.82, 0.50), (0.90, 0.40), (0.905, 0.24), (0.96, 0.11),
        (1.0, 0.0),
    ]
)  # fmt: skip


@dataclass(frozen=True)
class Hump:
    """A second lobe on top of the fuselage: the upper deck of a 747, the hold of a Beluga."""

    rise_m: float  # of its middle above the middle of the fuselage
    width_m: float
    height_m: float
    span_m: tuple[float, float, float, float]  # begins, full, full until, gone; from the nose


@dataclass(frozen=True)
class Wing:
    """A half wing, fin or stabiliser, by its straight leading edge and three chords."""

    apex_m: float  # leading edge at the root, from the nose
    root_z_m: float  # above the ground
    span_m: float  # of this half
    chords_m: tuple[float, float, float]  # root, kink, tip
    kink: float  # share of the half span
    sweep_deg: float  # of the leading edge
    dihedral_deg: float = 0.0
    thickness: tuple[float, float] = (0.14, 0.10)  # root, tip
    winglet_m: float = 0.0  # its height, 0: none


@dataclass(frozen=True)
class Engine:
    """A pair of engines, one under each wing."""

    out_m: float  # distance from the plane of symmetry
    front_m: float  # intake lip, from the nose
    diameter_m: float
    length_m: float
    clearance_m: float  # of the cowl above the ground
    suffix: str = ""  # of the part's name: "" or "_outer"

    @property
    def axis_z_m(self) -> float:
        """Height of its axis above the ground."""
        return self.clearance_m + self.diameter_m / 2


@dataclass(frozen=True)
class AirlinerShape:
    """Parameters of an airliner."""

    length_m: float
    width_m: float  # of the fuselage
    height_m: float  # of the fuselage
    axis_z_m: float  # of the fuselage's middle above the ground
    nose_m: float  # length of the nose
    tail_m: float  # length of the tail cone
    wing: Wing
    stabiliser: Wing
    fin: Wing
    engines: tuple[Engine, ...]
    hump: Hump | None = None
    endplate_m: float = 0.0  # height of the fins at the stabiliser's tips, 0: none

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "AirlinerShape":
        """The shape of a table of `shapes.toml`."""
        wings = {name: Wing(**values[name]) for name in ("wing", "stabiliser", "fin")}
        hump = Hump(**values["hump"]) if "hump" in values else None
        engines = tuple(Engine(**engine) for engine in values["engines"])
        return cls(**{**values, **wings, "engines": engines, "hump": hump})


def airliner(shape: AirlinerShape, structure_id: str) -> Member:
    """The mesh of an airliner: fuselage, fairing, wings, winglets, tail, engines and pylons."""
    parts, fin = [_fuselage(shape), _fairing(shape)], shape.fin
    back = float(np.tan(np.radians(fin.sweep_deg)))
    sections = _sections(fin, 0.0, lambda up: (-fin.apex_m - up * back, 0.0, fin.root_z_m + up))
    parts.append(foil_loft("fin", sections, _ACROSS))
    for side, name in ((1, "left"), (-1, "right")):
        for half, wing in (("wing", shape.wing), ("stabiliser", shape.stabiliser)):
            # The halves begin inside the fuselage, a little off the plane of symmetry: their roots are two.
            sections = _sections(wing, 0.02, partial(_leading, wing, side))
            parts.append(foil_loft(f"{half}_{name}", sections, _UP, stations=16))
        for engine in shape.engines:
            parts += [_nacelle(engine, name, side), _pylon(shape.wing, engine, name, side)]
        if shape.wing.winglet_m > 0:
            parts.append(_winglet(shape.wing, name, side))
        if shape.endplate_m > 0:
            parts.append(_endplate(shape, name, side))
    middle = np.array([shape.length_m / 2, 0.0, 0.0])
    parts = [Part(part.name, part.vertices + middle, part.triangles) for part in parts]
    return assemble(structure_id, "airliner", parts, "parametric airliner", landmarks=("engine", "fin"))


def _fuselage(shape: AirlinerShape) -> Part:
    nose = shape.nose_m * (1 - np.cos(np.linspace(0.06, np.pi / 2, 13)[:-1]))
    middle = np.linspace(shape.nose_m, shape.length_m - shape.tail_m, 23)[:-1]
    tail = shape.length_m - shape.tail_m * np.cos(np.linspace(0, np.pi / 2, 15))
    aft = np.concatenate([nose, middle, tail])
    full, middle_z = _fullness(shape, aft)
    lower = (full * shape.width_m / 2, full * shape.height_m / 2, np.zeros(len(aft)))
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    direction = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    radius = _reach(direction, *lower)
    if shape.hump is not None:
        radius = np.maximum(radius, _reach(direction, *_lobe(shape.hump, aft, lower)))
    rings = np.empty((len(aft), _AROUND, 3))
    rings[..., 0] = -aft[:, None]
    rings[..., 1] = radius * direction[:, 0]
    rings[..., 2] = middle_z[:, None] + radius * direction[:, 1]
    tip = np.array([0.0, 0.0, middle_z[0]])
    return loft("fuselage", rings, (tip, rings[-1].mean(axis=0)))


def _fullness(shape: AirlinerShape, aft: Floats) -> tuple[Floats, Floats]:
    """Share of the full section at each station, and the height of its middle above the ground."""
    fore = np.clip(aft / shape.nose_m, 0, 1)
    rear = np.clip((aft - shape.length_m + shape.tail_m) / shape.tail_m, 0, 1)
    taper = 1 - 0.93 * (0.25 * rear + 0.75 * rear**1.9) * _smoothstep(rear, -0.3, 0.35)
    full = (1 - (1 - fore) ** 2) ** 0.58 * taper
    droop = -0.17 * shape.height_m * (1 - fore) ** 2.2
    # The top of the tail runs almost level, its belly sweeps up.
    lift = 0.40 * shape.height_m * (1 - taper)
    return full, shape.axis_z_m + droop + lift


def _lobe(hump: Hump, aft: Floats, lower: tuple[Floats, Floats, Floats]) -> tuple[Floats, Floats, Floats]:
    begins, whole, until, gone = hump.span_m
    share = _smoothstep(aft, begins, whole) * (1 - _smoothstep(aft, until, gone))
    width, height, _ = lower
    wide, tall = hump.width_m / 2 - width, hump.height_m / 2 - height
    return width + share * wide, height + share * tall, share * hump.rise_m


def _smoothstep(value: Floats, start: float, stop: float) -> Floats:
    """0 before `start`, 1 after `stop`, smooth between."""
    t = np.clip((value - start) / (stop - start), 0, 1)
    return t * t * (3 - 2 * t)


def _reach(direction: Floats, half_width: Floats, half_height: Floats, rise: Floats) -> Floats:
    """Distance (S, K) from the fuselage's middle to an ellipse whose centre lies `rise` above it."""
    y, z = direction[None, :, 0] / half_width[:, None], direction[None, :, 1] / half_height[:, None]
    offset = (rise / half_height)[:, None]
    a, b, c = y * y + z * z, -z * offset, offset**2 - 1
    return np.asarray((-b + np.sqrt(np.maximum(b * b - a * c, 0))) / a)


def _fairing(shape: AirlinerShape) -> Part:
    root = shape.wing.chords_m[0]
    along = np.linspace(0, np.pi, 13)[1:-1, None]
    aft = shape.wing.apex_m + root * (0.55 - 0.72 * np.cos(along))
    swell, outline = np.sin(along) ** 0.7, superellipse(24, 2.6)
    y = 0.53 * shape.width_m * swell * outline[:, 0]
    z = shape.axis_z_m - 0.36 * shape.height_m + 0.20 * shape.height_m * swell * outline[:, 1]
    return loft("fairing", np.stack([np.broadcast_to(-aft, y.shape), y, z], axis=-1))


def _sections(wing: Wing, root: float, edge: Callable[[float], tuple[float, float, float]]) -> list[Section]:
    """The airfoils of a half at its root, a share of the span from the middle, at its kink and at its tip."""
    (thick, thin), shares = wing.thickness, (root, wing.kink, 1.0)
    rows = zip(shares, wing.chords_m, strict=True)
    return [(edge(share * wing.span_m), chord, thick + share * (thin - thick)) for share, chord in rows]


def _leading(wing: Wing, side: int, out: float) -> tuple[float, float, float]:
    """Leading edge of the wing at a distance from the plane of symmetry."""
    back, up = (float(np.tan(np.radians(angle))) for angle in (wing.sweep_deg, wing.dihedral_deg))
    return -wing.apex_m - out * back, side * out, wing.root_z_m + out * up


def _winglet(wing: Wing, name: str, side: int) -> Part:
    x, y, z = _leading(wing, side, wing.span_m)
    chord, height = wing.chords_m[2], wing.winglet_m
    root = (x - 0.12 * chord, y - side * 0.02, z)
    tip = (x - 0.15 * chord - 0.75 * height, y + side * 0.25 * height, z + height)
    sections = [(root, 0.86 * chord, 0.09), (tip, 0.4 * chord, 0.07)]
    return foil_loft(f"winglet_{name}", sections, _ACROSS, stations=5)


def _endplate(shape: AirlinerShape, name: str, side: int) -> Part:
    x, y, z = _leading(shape.stabiliser, side, shape.stabiliser.span_m)
    chord, height = shape.stabiliser.chords_m[2], shape.endplate_m
    sections = [
        ((x + 0.35 * chord - 0.35 * share * height, y, z + (share - 0.4) * height), size * chord, 0.09)
        for share, size in ((0.0, 1.0), (0.45, 1.3), (1.0, 0.75))
    ]
    return foil_loft(f"endplate_{name}", sections, _ACROSS, stations=8)


def _nacelle(engine: Engine, name: str, side: int) -> Part:
    origin = np.array([-engine.front_m, side * engine.out_m, engine.axis_z_m])
    profile = _COWL * (engine.length_m, engine.diameter_m / 2)
    return revolve(f"engine_{name}{engine.suffix}", profile, origin, np.array([-1.0, 0.0, 0.0]))


def _pylon(wing: Wing, engine: Engine, name: str, side: int) -> Part:
    """From inside the cowl to inside the wing."""
    x, y, z = _leading(wing, side, engine.out_m)
    chord = float(np.interp(engine.out_m / wing.span_m, (0.0, wing.kink, 1.0), wing.chords_m))
    low = engine.axis_z_m + 0.55 * engine.diameter_m / 2
    crest = min(engine.axis_z_m + 0.53 * engine.diameter_m, z - 0.15 * (z - low))
    front, rear = -engine.front_m - 0.16 * engine.length_m, x - 0.45 * chord
    middle = front - 0.02 * engine.length_m
    sections = [((front, y, low), 0.72 * engine.length_m, 0.09), ((middle, y, crest), middle - rear, 0.06)]
    sections.append(((x - 0.02 * chord, y, z), 0.5 * chord, 0.06))
    return foil_loft(f"pylon_{name}{engine.suffix}", sections, _ACROSS, stations=6)
