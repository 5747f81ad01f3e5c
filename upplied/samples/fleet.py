"""The sample fleet: fourteen structures of five kinds."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from upplied.errors import InputError
from upplied.records import Demonstration, Placement, Structure
from upplied.samples.airliner import AirlinerShape, airliner
from upplied.samples.parametric import BridgeShape, ShipShape, TurbineShape, bridge, ship, turbine
from upplied.samples.pilot import fly
from upplied.samples.surfaces import Member, box

#: The shape of each sample structure, by kind and id.
SHAPES: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("shapes.toml").read_text("utf-8"))
_KINDS = {structure_id: kind for kind, shapes in SHAPES.items() for structure_id in shapes}
_MAKERS: dict[str, tuple[Callable[[Any], Any], Callable[[Any, str], Member]]] = {
    "airliner": (AirlinerShape.of, airliner),
    "wind_turbine": (lambda values: TurbineShape(**values), turbine),
    "ship": (lambda values: ShipShape(**values), ship),
    "box": (tuple, box),
    "bridge": (lambda values: BridgeShape(**values), bridge),
}
# Where they would stand: on an airfield, in a wind park, in a harbour, in a town.
_SITES = {
    "airliner": ("Finkenwerder apron", 53.5352, 9.8350, 48.2),
    "wind_turbine": ("Marsh wind park", 53.8900, 9.1000, 42.6),
    "ship": ("Elbe roads", 53.5420, 9.9360, 43.9),
    "box": ("Old town", 53.5500, 9.9900, 52.0),
    "bridge": ("River crossing", 53.4700, 9.9800, 45.5),
}
# The demonstrations of the paper's tables.
_FLIGHTS = (
    ("a320-v1", "fuselage"), ("a320-v1", "wings"), ("a320-v1", "engine_left"), ("turbine-1-v1", "tower"),
    ("cruise-v1", "hull"), ("cube-v1", "sides"), ("bridge-1-v1", "piers"),
)  # fmt: skip


def sample_demonstrations() -> list[Demonstration]:
    """The flights of the paper's tables round the sample fleet, such as ``a320-fuselage-v1``."""
    return [
        fly(member(structure_id).structure, inspection, seed=number)
        for number, (structure_id, inspection) in enumerate(_FLIGHTS)
    ]


def sample_structures() -> list[Structure]:
    """Every structure of the sample fleet."""
    return [member(structure_id).structure for structure_id in _KINDS]


@cache
def member(structure_id: str) -> Member:
    """A sample structure with its parts. Raises InputError if there is no sample of that id."""
    if structure_id not in _KINDS:
        known = ", ".join(sorted(_KINDS))
        raise InputError(f"sample structure {structure_id!r}", "is unknown", f"one of {known}")
    kind, row = _KINDS[structure_id], list(_KINDS).index(structure_id)
    sample = _MAKERS[kind][1](shape_of(structure_id), structure_id)
    site, lat, lon, alt = _SITES[kind]
    placement = Placement(lat, round(lon + 0.002 * row, 6), alt, (75.0 + 23.0 * row) % 360)
    return replace(sample, structure=replace(sample.structure, site=site, placement=placement))


def shape_of(structure_id: str) -> Any:
    """The parameters of a sample structure for its maker."""
    kind = _KINDS[structure_id]
    return _MAKERS[kind][0](SHAPES[kind][structure_id])
