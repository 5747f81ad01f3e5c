"""The sample fleet: fourteen structures of five kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

from upplied.errors import InputError
from upplied.records import Demonstration, Placement, Structure
from upplied.samples.airliner import airliner
from upplied.samples.airliner_shapes import A320, B747, B777, BELUGA
from upplied.samples.box import box
from upplied.samples.bridge import BRIDGE_1, BRIDGE_2, bridge
from upplied.samples.pilot import fly
from upplied.samples.ship import CRUISE, YACHT_1, YACHT_2, ship
from upplied.samples.surfaces import Member
from upplied.samples.turbine import TURBINE_1, TURBINE_2, TURBINE_3, turbine

_MAKERS: dict[str, Callable[[str], Member]] = {
    "a320-v1": partial(airliner, A320),
    "beluga-v1": partial(airliner, BELUGA),
    "b747-v1": partial(airliner, B747),
    "b777-v1": partial(airliner, B777),
    "turbine-1-v1": partial(turbine, TURBINE_1),
    "turbine-2-v1": partial(turbine, TURBINE_2),
    "turbine-3-v1": partial(turbine, TURBINE_3),
    "cruise-v1": partial(ship, CRUISE),
    "yacht-1-v1": partial(ship, YACHT_1),
    "yacht-2-v1": partial(ship, YACHT_2),
    "cube-v1": partial(box, (12.0, 12.0, 12.0)),
    "cuboid-v1": partial(box, (20.0, 12.0, 9.0)),
    "bridge-1-v1": partial(bridge, BRIDGE_1),
    "bridge-2-v1": partial(bridge, BRIDGE_2),
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
    ("a320-v1", "fuselage"),
    ("a320-v1", "wings"),
    ("a320-v1", "engine_left"),
    ("turbine-1-v1", "tower"),
    ("cruise-v1", "hull"),
    ("cube-v1", "sides"),
    ("bridge-1-v1", "piers"),
)


def sample_demonstrations() -> list[Demonstration]:
    """The flights of the paper's tables round the sample fleet, such as ``a320-fuselage-v1``."""
    return [
        fly(member(structure_id).structure, inspection, seed=number)
        for number, (structure_id, inspection) in enumerate(_FLIGHTS)
    ]


def sample_structures() -> list[Structure]:
    """Every structure of the sample fleet."""
    return [member(structure_id).structure for structure_id in _MAKERS]


@cache
def member(structure_id: str) -> Member:
    """A sample structure with its parts.

    Raises
    ------
    InputError
        If there is no sample of that id.
    """
    if structure_id not in _MAKERS:
        raise InputError(
            f"sample structure {structure_id!r}", "is unknown", f"one of {', '.join(sorted(_MAKERS))}"
        )
    sample = _MAKERS[structure_id](structure_id)
    site, lat, lon, alt = _SITES[sample.structure.kind]
    row = list(_MAKERS).index(structure_id)
    placement = Placement(lat, round(lon + 0.002 * row, 6), alt, (75.0 + 23.0 * row) % 360)
    return replace(sample, structure=replace(sample.structure, site=site, placement=placement))
