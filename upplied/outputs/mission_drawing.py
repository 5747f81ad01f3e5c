"""A mission as a pilot reads it, as SVG: a map, north up, and the heights over the distance flown."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from upplied.geometry.polylines import arc_length
from upplied.geometry.scene import scene_of
from upplied.outputs.draw.tubes import frustum_corners
from upplied.outputs.missions.records import Mission
from upplied.outputs.pages import asset, image_address
from upplied.records import Bools, Camera, Floats, Plan, Structure

_SIZE = np.array([640, 400])  # of a drawing, in its own units
_ROOM, _LEFT = 24.0, 64.0  # at its edges, and left of the heights
_FLIGHTS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito
_TRANSIT, _LIMIT, _FOOTPRINT, _RETURN, _GROUND = "#7a7a7a", "#b3261e", "#e69f00", "#d55e00", "#5f6b78"
_RAYS, _STEP = 25, 1.5  # rays across a photo and down; most ratio of depths that is one surface
_ROUND_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


@dataclass(frozen=True)
class Flight:
    """One flight of a mission, or a plan of which no mission can be written."""

    positions: Floats  # (N, 3) m, structure frame
    quat_xyzw: Floats  # (N, 4) camera to structure
    inspect: Bools  # (N,) False on transit legs
    photo: Bools  # (N,)

    @property
    def runs(self) -> Iterator[tuple[bool, slice]]:
        """Waypoints that follow each other, on the inspection or on a transit leg."""
        inside = self.inspect[1:] & self.inspect[:-1]
        changes = np.flatnonzero(inside[1:] != inside[:-1]) + 1
        for start, end in pairwise([0, *changes.tolist(), len(inside)] if len(inside) else []):
            yield bool(inside[start]), slice(start, end + 1)


@dataclass(frozen=True)
class MissionDrawing:
    """The flights round a structure, and what limits them."""

    structure: Structure
    flights: Sequence[Flight]
    camera: Camera
    heading_deg: float = 90.0  # of the structure's +X, clockwise from true north
    home: Floats | None = None  # (3,) m, structure frame; None: the place on the Earth is unknown
    return_m: float = float("nan")  # height of an automatic return above home

    @classmethod
    def of_missions(
        cls, missions: Sequence[Mission], structure: Structure, camera: Camera
    ) -> "MissionDrawing":
        """The sorties of a plan."""
        flights = [Flight(one.local, one.quat_xyzw, one.inspect, one.photo) for one in missions]
        first = missions[0]
        place = first.placement.heading_deg, first.home_local, first.return_height_m
        return cls(structure, flights, camera, *place)

    @classmethod
    def of_plan(cls, plan: Plan, structure: Structure, camera: Camera) -> "MissionDrawing":
        """The path of a plan, with a photo at each viewpoint."""
        path, photo = plan.trajectory, plan.is_viewpoint
        assert path is not None and photo is not None
        flight = Flight(path.positions, path.quat_xyzw, np.ones(len(path), bool), photo)
        return cls(structure, [flight], camera)

    def map(self) -> str:
        """The structure from above, with paths, photos, their footprints, and what must not be entered."""
        turn = np.radians(self.heading_deg)
        axes = np.array([[np.sin(turn), -np.cos(turn)], [np.cos(turn), np.sin(turn)]])  # east and north
        homes = [] if self.home is None else [self.home[None]]
        every = np.concatenate([self.structure.vertices, *(one.positions for one in self.flights), *homes])
        flat = every[:, :2] @ axes.T
        middle, extent = (flat.min(axis=0) + flat.max(axis=0)) / 2, np.maximum(np.ptp(flat, axis=0), 1e-6)
        scale = float(((_SIZE - 2 * _ROOM) / extent).min())

        def at(places: Floats) -> Floats:
            return np.asarray(_SIZE / 2 + scale * (places[..., :2] @ axes.T - middle) * [1, -1])

        across, down = (each.ravel() for each in np.meshgrid(*(np.arange(side) + 0.5 for side in _SIZE)))
        level = ((np.column_stack([across, down]) - _SIZE / 2) * [1, -1] / scale + middle) @ axes
        above = np.column_stack([level, np.full(len(level), every[:, 2].max() + 1.0)])
        reach = scene_of(self.structure).cast(above, np.tile([0.0, 0.0, -1.0], (len(above), 1)))[0]
        footprints = [cells for flight in self.flights for cells in self._footprints(flight)]
        count = sum((_filled(at(cells)) for cells in footprints), np.zeros(_SIZE[::-1]))
        opacity = np.clip(6 / max(len(footprints), 1), 0.1, 0.4)
        parts = [_masked("structure", np.isfinite(reach).reshape(_SIZE[::-1]), 'class="structure"')]
        parts.append(_masked("footprints", 1 - (1 - opacity) ** count, f'style="fill: {_FOOTPRINT}"'))
        parts += [_path(at(area), _LIMIT, "Z") for area in self._limits]
        for number, flight in enumerate(self.flights):
            for home in homes:
                parts.append(_path(at(np.concatenate([home, flight.positions[:1]])), _TRANSIT))
            drawn = at(flight.positions)
            parts += [_path(drawn[run], _colour(number, inside)) for inside, run in flight.runs]
            dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in drawn[flight.photo])
            parts.append(f'<path class="ink" d="{dots}" style="stroke-width: 4"/>')
        for x, y in (at(home[0]) for home in homes):
            square = 'style="stroke-width: 10; stroke-linecap: square"'
            parts.append(f'<path class="ink" d="M{x:.1f} {y:.1f}h0" {square}/>{_text(x + 10, y + 5, "H")}')
            parts.append('<path class="ink" d="M18 44V14M13 22L18 12L23 22"/>' + _text(18, 62, "N", "middle"))
        bar_m = max(step for step in _ROUND_M if step == 1 or step * scale < _SIZE[0] / 4)
        parts.append(f'<path class="ink" d="M12 390h{bar_m * scale:.1f}" style="stroke-width: 3"/>')
        return _svg([*parts, _text(12, 382, f"{bar_m} m")])

    def heights(self) -> str:
        """Heights above take-off, or above the ground where that is unknown, over the distance flown."""
        ground, ceiling = self.structure.floor_z_m, self.structure.surroundings.ceiling_z_m
        zero = ground if self.home is None else float(self.home[2])
        levels = [("ground", ground, _GROUND), ("return to home", zero + self.return_m, _RETURN)]
        levels += [] if ceiling is None else [("ceiling", ceiling, _LIMIT)]
        levels = [each for each in levels if np.isfinite(each[1])]
        path = np.concatenate([one.positions for one in self.flights])
        z = np.concatenate([path[:, 2], [zero], [level for _, level, _ in levels]])
        low, high = z.min(), z.max()
        lengths = [arc_length(one.positions) for one in self.flights]
        starts = np.cumsum([0.0, *(length[-1] for length in lengths)])
        wide, high_m = max(starts[-1], 1e-6), max(high - low, 1e-6)

        def at(distance: Floats, z: Floats) -> Floats:
            return np.column_stack([_LEFT + 558 * distance / wide, 360 - 330 * (z - low) / high_m])

        parts = []
        for name, level, colour in levels:
            line, words = at(np.array([0.0, wide]), np.full(2, level)), f"{name} {round(level - zero)} m"
            parts.append(_path(line, colour) + _text(614, line[0, 1] - 5, words, "end"))
        for number, (flight, length) in enumerate(zip(self.flights, lengths, strict=True)):
            x, z = starts[number] + length, flight.positions[:, 2]
            for end in (0, -1) if self.home is not None else ():
                parts.append(_path(at(x[[end, end]], np.array([zero, z[end]])), _TRANSIT))
            parts += [_path(at(x[run], z[run]), _colour(number, inside)) for inside, run in flight.runs]
        for height in _ticks(low - zero, high - zero, 5):
            parts.append(_text(_LEFT - 8, 364 - 330 * (height + zero - low) / high_m, f"{height:g} m", "end"))
        for distance in _ticks(0.0, wide, 5):
            parts.append(_text(_LEFT + 558 * distance / wide, 386, f"{distance:g} m", "middle"))
        return _svg(parts)

    def legend(self) -> list[tuple[str, str, str]]:
        """What the drawings show: in words, the kind of its mark, and its colour."""
        several = len(self.flights) > 1
        words = [f"flight {at + 1}" if several else "inspection path" for at in range(len(self.flights))]
        marks = [(word, "line", _colour(at, True)) for at, word in enumerate(words)]
        if self.home is not None:
            marks = [("take-off", "home", ""), *marks, ("transit legs", "line", _TRANSIT)]
        if self._limits:
            marks.append(("keep-out area or geofence", "line", _LIMIT))
        return [*marks, ("photo", "photo", ""), ("footprint of a photo", "footprint", "")]

    @property
    def _limits(self) -> list[Floats]:
        """Areas not to be entered or left, each by its corners (C, 2) m."""
        around = self.structure.surroundings
        boxes = [np.array([[x, y], [u, y], [u, v], [x, v]]) for (x, y, _), (u, v, _) in around.keep_out_m]
        return [*boxes, *([around.geofence_m] if len(around.geofence_m) else [])]

    def _footprints(self, flight: Flight) -> Iterator[Floats]:
        """The surface in each photo and in range, in cells (C, 4, 3), m, between rays that meet it."""
        taken = flight.photo if flight.photo.any() else flight.inspect
        positions, quats = flight.positions[taken], flight.quat_xyzw[taken]
        corners = frustum_corners(positions, quats, self.camera, 1.0) - positions[:, None]
        left, up = (each.ravel() for each in np.meshgrid(*2 * [np.linspace(0.0, 1.0, _RAYS)]))
        share = np.stack([left * up, (1 - left) * up, (1 - left) * (1 - up), left * (1 - up)])
        number = np.arange(_RAYS**2).reshape(_RAYS, _RAYS)
        cells = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=2)
        cells = cells.reshape(-1, 4)
        for place, rays in zip(positions, np.einsum("cr,ncx->nrx", share, corners), strict=True):
            depth_m = scene_of(self.structure).cast(np.tile(place, (len(rays), 1)), rays)[0]
            near, far = depth_m[cells].min(axis=1), depth_m[cells].max(axis=1)
            whole = (far <= self.camera.max_range_m) & (far < _STEP * near)  # of one surface
            yield place + depth_m[cells[whole], None] * rays[cells[whole]]


def _filled(cells: Floats) -> Bools:
    """The pixels (H, W) in any of some cells (C, 4, 2) of a drawing, or beside one: a wall is a line."""
    picture = Image.new("L", _SIZE.tolist())
    for corners in cells.tolist():
        ImageDraw.Draw(picture).polygon([*map(tuple, corners)], fill=1, outline=1)
    return np.asarray(picture.filter(ImageFilter.MaxFilter(5)), bool)


def _masked(name: str, opacity: Floats | Bools, style: str) -> str:
    """A drawing in one colour with an opacity (H, W)."""
    png = io.BytesIO()
    Image.fromarray((255 * opacity).astype(np.uint8)).save(png, "PNG")
    source = image_address(png.getvalue())
    size = f'width="{_SIZE[0]}" height="{_SIZE[1]}"'
    mask = f'<mask id="{name}"><image {size} href="{source}"/></mask>'
    return f'{mask}<rect {style} {size} mask="url(#{name})"/>'


def _colour(number: int, inside: bool) -> str:
    return _FLIGHTS[number % len(_FLIGHTS)] if inside else _TRANSIT


def _path(places: Floats, colour: str, end: str = "") -> str:
    line = "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
    return f'<path d="M{line}{end}" style="stroke: {colour}"/>'


def _text(x: float, y: float, words: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'


def _ticks(low: float, high: float, most: int) -> Floats:
    """Round values between two others, at most so many steps apart."""
    step = next((each for each in _ROUND_M if high - low <= most * each), _ROUND_M[-1])
    return np.asarray(np.arange(np.ceil(low / step - 1e-6), np.floor(high / step + 1e-6) + 1) * step + 0.0)


def _svg(parts: Sequence[str]) -> str:
    size = f'width="{_SIZE[0]}" height="{_SIZE[1]}" viewBox="0 0 {_SIZE[0]} {_SIZE[1]}"'
    style = f"<style>{asset('drawing.css')}</style>"
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{style}{"".join(parts)}</svg>'
    return image_address(svg.encode(), "svg+xml")
