"""The pictures of the documentation and the figures under them, from the sample fleet; same bytes each time.

The fleet goes the user's way, through mesh files, logs and a catalog: what a log rounds and a mesh file
turns shows in a plan, and published figures are those that the quickstart prints.

Run `make pictures` after a change of the method: it takes some minutes.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from upplied import Catalog, open_catalog
from upplied.config import settings_for
from upplied.files import replace_file
from upplied.fleet.ingest import find_logs, ingest_demonstrations, ingest_structures
from upplied.outputs import figures
from upplied.outputs.colours import DEMONSTRATED, PRESETS
from upplied.outputs.draw.views import facing
from upplied.outputs.sample_fleet import write_sample_fleet
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.repetition import inspected_states, takes_of
from upplied.planning.plan import METHOD_VERSION, plan_transfer
from upplied.planning.visibility.observations import BY_FRUSTUM, TRULY, views
from upplied.records import SURFACE_STATES, Bools, Cloud, Demonstration, Plan, Structure, SurfaceStates
from upplied.simulate import Wind, fly_trajectory, measure_flown

HERE = Path(__file__).parents[1] / "pictures"
RECOMMENDED = settings_for("recommended")
_COLOURS = 256
#: Demonstration, target: what the table of the method's page shows.
SHOWN = (
    ("a320-fuselage-v1", "b747-v1"),
    ("turbine-1-tower-v1", "turbine-2-v1"),
    ("cruise-hull-v1", "yacht-1-v1"),
    ("cube-sides-v1", "cuboid-v1"),
    ("bridge-1-piers-v1", "bridge-2-v1"),
)


def main() -> None:
    """Make every picture, and the table of measures."""
    with TemporaryDirectory() as folder:
        catalog = ingested(Path(folder))
        structures = {name: catalog.structure(name) for name in catalog.structures()["structure_id"]}
        flights = {name: catalog.demonstration(name) for name in catalog.demonstrations()["demonstration_id"]}
    _draw(structures, flights)


def ingested(folder: Path) -> Catalog:
    """A catalog with the sample fleet, taken in from its files as `upplied quickstart` does."""
    manifest = write_sample_fleet(folder / "samples")
    catalog = open_catalog(folder / "catalog")
    taken = ingest_structures(catalog, manifest)
    taken += ingest_demonstrations(catalog, find_logs([folder / "samples"]))
    refused = [item for item in taken if item.status != "added"]
    if refused:
        raise SystemExit(f"the sample fleet was not taken in: {refused[0]}")
    return catalog


def _draw(structures: Mapping[str, Structure], flights: Mapping[str, Demonstration]) -> None:
    _seen(structures["a320-v1"], flights["a320-wings-v1"])
    attended(flights, structures)
    _refused(flights["a320-fuselage-v1"], structures["a320-v1"], structures["cruise-v1"])
    rows = []
    for flight_id, target_id in SHOWN:
        flight, target = flights[flight_id], structures[target_id]
        source = structures[flight.structure_id]
        plans = [plan_transfer(flight, source, target, settings_for(preset)) for preset in reversed(PRESETS)]
        plans.sort(key=lambda plan: ("recommended", "paper", "baseline").index(plan.preset))
        rows += [_row(plan) for plan in plans]
        name = f"{flight_id}--{target_id}"
        _save(name, figures.transfer_png(source, target, flight, plans[0], width=1200))
        if target_id == "b747-v1":
            _save("presets", figures.comparison_png(target, plans, width=1300))
            rows.append(_flown(plans[0], flight, source, target))
    _write_table(rows)


def _seen(source: Structure, flight: Demonstration) -> None:
    """What the frustum alone takes for seen, and what is really seen, on the demonstrated structure."""
    pair = study_pair(source, source, RECOMMENDED)
    cloud = pair.surface.source
    watched = flight.trajectory, cloud, flight.camera
    for name, seen in (
        ("seen-by-frustum", views(*watched, BY_FRUSTUM).total),
        ("truly-seen", views(*watched, TRULY, pair.source_scene).total),
    ):
        title = f"{name.replace('-', ' ')}: {_share(cloud, seen):.0f} % of the surface"
        states = SurfaceStates(
            cloud.points,
            np.where(seen, SURFACE_STATES.index("shown"), SURFACE_STATES.index("other")),
            cloud.normals,
        )
        path = [("demonstrated path", flight, DEMONSTRATED)]
        _save(
            name,
            figures.structure_png(
                source, ["below"], states=states, trajectories=path, title=title, width=700
            ),
        )


def attended(flights: Mapping[str, Demonstration], structures: Mapping[str, Structure]) -> None:
    """What each flight was about, on its own structure."""
    for name, flight in flights.items():
        source = structures[flight.structure_id]
        take = takes_of(flight, study_pair(source, source, RECOMMENDED), RECOMMENDED)[0]
        states = inspected_states(take)
        path = [("demonstrated path", flight, DEMONSTRATED)]
        title = f"{name}: what it was about"
        side = [facing(source.vertices, flight.positions)]
        picture = figures.structure_png(
            source, side, states=states, trajectories=path, title=title, width=700
        )
        _save(f"attention-{name.removesuffix('-v1')}", picture)


def _share(cloud: Cloud, seen: Bools) -> float:
    assert cloud.area_m2 is not None
    return 100 * float(cloud.area_m2[seen].sum() / cloud.area_m2.sum())


def _refused(flight: Demonstration, source: Structure, target: Structure) -> None:
    plan = plan_transfer(flight, source, target, RECOMMENDED)
    _save("refused", figures.transfer_png(source, target, flight, plan, width=1200))


def _flown(plan: Plan, flight: Demonstration, source: Structure, target: Structure) -> str:
    """The plan flown in gusts: a picture, and a row of the table."""
    assert plan.trajectory is not None
    air = fly_trajectory(plan.trajectory, wind=Wind(speed_mps=8.0), seed=1)
    flown = measure_flown(air, plan, flight, source, target, RECOMMENDED)
    paths = [("planned", plan.trajectory, PRESETS["recommended"]), ("flown", air, DEMONSTRATED)]
    title = f"flown in wind of 8 m/s: clearance {flown.measures.min_clearance_m:.2f} m"
    _save("flown", figures.structure_png(target, ["top"], trajectories=paths, title=title, width=1000))
    return _row(flown, "recommended, flown in 8 m/s of wind")


def _row(plan: Plan, name: str = "") -> str:
    measures = plan.measures
    cells = [plan.demonstration_id, plan.target_id, name or plan.preset]
    cells += [
        f"{value:{form}}"
        for value, form in (
            (measures.coverage_inspected_pct, ".1f"),
            (measures.coverage_seen_pct, ".1f"),
            (measures.coverage_paper_pct, ".1f"),
            (measures.frechet_z, ".2f"),
            (measures.min_clearance_m, ".2f"),
        )
    ]
    return f"| {' | '.join(cells)} |"


def _write_table(rows: list[str]) -> None:
    head = "| flight | target | preset | inspected % | seen % | paper's % | Fréchet | least clearance, m |"
    introduction = f"Measured with version {METHOD_VERSION} of the method:\n"
    text = "\n".join([introduction, head, "|---|---|---|---:|---:|---:|---:|---:|", *rows]) + "\n"
    (HERE / "measured.md").write_text(text, encoding="utf-8")


def _save(name: str, png: bytes) -> None:
    """A picture of few colours: a third of the bytes, and nothing that the eye would miss."""
    image = Image.open(io.BytesIO(png)).quantize(_COLOURS, dither=Image.Dither.NONE)
    out = io.BytesIO()
    image.save(out, "PNG", optimize=True)
    replace_file(HERE / f"{name}.png", out.getvalue())


if __name__ == "__main__":
    HERE.mkdir(exist_ok=True)
    main()
