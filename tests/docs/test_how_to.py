"""The how-to pages: every block of code is run as it stands, in the folder that the tutorial leaves."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_logs import Flight, poses, write_log
from scipy.spatial.transform import Rotation

from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.flows.transfer_fleet import transfer_fleet
from upplied.geometry.poses import from_yaw_pitch
from upplied.outputs.logs import write_log as write_flight

DOCS = Path(__file__).parents[2] / "docs"
#: Pages whose blocks other tests run.
ELSEWHERE = {
    "tutorial.md": "docs/test_docs_site.py",
    "ten-minutes.md": "docs/test_ten_minutes.py",
    "queries.md": "catalog/test_catalog_guide.py",
    "operating.md": "flows/test_operating.py",
    "how-to/project.md": "docs/test_project_page.py",
    "how-to/findings.md": "findings/test_findings_page.py",
}
#: Commands that are not run here, and why.
NOT_RUN = {
    "make quickstart": "builds an environment; continuous integration runs it",
    "upplied studio": "serves until it is stopped; web/test_studio.py does so",
    "upplied serve": "serves until it is stopped; test_wheel.py does so",
    "upplied fleet run": "needs that server; test_flows.py runs the flow",
    "prefect worker": "works until it is stopped; test_machines.py has such workers",
    "export AWS": "needs a bucket; test_catalog_store.py and test_machines.py work on one",
}


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and text of each block of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    matches = re.findall(r"^( *)```(\w+)\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    return [
        (language, re.sub(rf"^{indent}", "", body, flags=re.MULTILINE)) for indent, language, body in matches
    ]


def commands(text: str) -> list[str]:
    """The commands of a block of shell, without comments."""
    lines = re.split(r"\n|&&", text.replace("\\\n", " "))
    return [line.split(" #")[0].strip() for line in lines if line.split(" #")[0].strip()]


def run(command: str) -> None:
    """A command of ours, in this process."""
    assert command.startswith("upplied "), f"{command}: neither ours nor in NOT_RUN"
    assert main(shlex.split(command)[1:]) == 0, command


def is_run(command: str) -> bool:
    return not command.startswith(tuple(NOT_RUN))


PAGES = sorted({f"how-to/{path.name}" for path in (DOCS / "how-to").glob("*.md")} - ELSEWHERE.keys())
RUN = [(page, at) for page in PAGES for at, (_, text) in enumerate(blocks(page)) if is_run(commands(text)[0])]


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Iterator[Path]:
    """The folder in which the tutorial was followed up to its report, and what its reader has besides."""
    folder = tmp_path_factory.mktemp("how-to")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.delenv("UPPLIED_CATALOG", raising=False)
        (_, code), *shell, _ = blocks("tutorial.md")
        exec(code, {})
        for _, text in shell:
            for command in commands(text):
                run(command)
        shutil.copytree("logs", "fleet/logs")
        for name in ("structures.toml", "tank-1.ply", "tank-2.stl"):
            shutil.copy(name, Path("fleet") / name)
        write_log(Path("flight.mcap"), [own_flight()])
        _, zones, _, welds = blocks("how-to/zones.md")
        Path("monthly.toml").write_text(zones[1], encoding="utf-8")
        Path("welds.toml").write_text(welds[1], encoding="utf-8")
        faces = len(open_catalog("catalog").structure("tank-2").triangles)
        np.save("tank-2.npy", np.arange(faces) // 50)
        Path("flown").mkdir()
        flown_log(Path("flown/tank-2.mcap"))
        yield folder


def own_flight():
    """A drone's body thrice round the tank, its camera to the wall, as the side-car of the page says."""
    angle = np.linspace(0.3, 6 * np.pi - 0.3, 700)
    at_tank = np.column_stack([10 * np.cos(angle), 10 * np.sin(angle), np.full(700, 5.0)])
    turn = Rotation.from_quat([0.0, 0.0, 0.2588, 0.9659])
    body = Rotation.from_quat(from_yaw_pitch(angle + np.pi, np.zeros(700)))
    carrier = at_tank - body.apply([0.12, 0.0, -0.05])
    positions = turn.apply(carrier) + np.array([12.0, -3.5, 0.0])
    t_ns = 1_767_600_000_000_000_000 + np.arange(700, dtype=np.int64) * 10**9
    return poses(
        "/drone/pose", "geometry_msgs/msg/PoseStamped", Flight(t_ns, positions, (turn * body).as_quat())
    )


def flown_log(path: Path) -> None:
    """The first half of the tutorial's plan, flown within a decimetre, as vehicles do."""
    catalog = open_catalog("catalog")
    row = catalog.transfers(preset="recommended", status="ok").iloc[0]
    planned, flown = catalog.trajectory(row["transfer_id"]), catalog.demonstration(row["demonstration_id"])
    half = planned.t_s <= planned.t_s[-1] / 2
    t_ns = flown.t_ns[0] + np.round(planned.t_s[half] * 1e9).astype(np.int64)
    aside = 0.1 * np.sin(planned.t_s[half, None] / [7.0, 11.0, 13.0])
    poses = {"positions": planned.positions[half] + aside, "quat_xyzw": planned.quat_xyzw[half]}
    target = catalog.structure(row["target_id"])
    record = replace(flown, demonstration_id="tank-2-flown", structure_id="tank-2", t_ns=t_ns, **poses)
    write_flight(path, record, target, heavy_topic=False)


@pytest.mark.slow
@pytest.mark.parametrize(("page", "at"), RUN, ids=lambda part: str(part).removeprefix("how-to/"))
def test_blocks_of_the_how_to_pages_run(place, page, at):
    language, text = blocks(page)[at]
    if language == "toml":
        names = {"drone-log.md": "flight.toml", "zones.md": "monthly.toml"}
        goal = names.get(page.removeprefix("how-to/"), "structures.toml")
        (place / goal).write_text(text, encoding="utf-8")
    elif language == "yaml":
        values = yaml.safe_load(text)["parameters"]
        transfer_fleet.validate_parameters(values)
        assert (place / values["manifest"]).is_file() and all(
            (place / log).is_dir() for log in values["logs"]
        )
    elif language == "python":
        before = [body for other, body in blocks(page)[:at] if other == "python"]
        exec("\n".join([*before, text]), {})
    else:
        catalog = open_catalog("catalog")
        plan = catalog.transfers(preset="recommended", status="ok")["transfer_id"].iloc[0]
        for command in filter(is_run, commands(text)):
            flown = catalog.flights(kind="flown")["flight_id"]
            run(command.replace("TRANSFER", plan).replace("FLIGHT", flown.iloc[0] if len(flown) else ""))


@pytest.mark.slow
def test_a_body_with_a_mount_is_the_camera_it_carries(place):
    """The side-car of the page says the truth: the flight is where it was, the camera 10 m from the axis."""
    known = open_catalog(str(place / "catalog")).demonstrations()
    if "flight" not in set(known["demonstration_id"]):
        pytest.skip("runs after the page that reads the log")
    flown = open_catalog(str(place / "catalog")).demonstration("flight")
    assert np.allclose(np.hypot(*flown.positions[:, :2].T), 10.0, atol=2e-3)
    assert np.allclose(flown.positions[:, 2], 5.0, atol=1e-3)
    assert len(flown) == 571  # from second 40 to 610


def test_every_block_of_the_documentation_is_run_somewhere():
    for path in DOCS.rglob("*.md"):
        page = str(path.relative_to(DOCS))
        for language, text in blocks(page):
            known = page in ELSEWHERE or page in PAGES or not any(map(is_run, commands(text)))
            assert known, f"{page}: nobody runs this {language}: {text[:60]}"
    for test in ELSEWHERE.values():
        assert (Path(__file__).parents[1] / test).is_file()
