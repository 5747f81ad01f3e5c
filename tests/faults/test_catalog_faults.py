"""Many writers, readers all the time, and kills at random: nothing acknowledged is ever lost."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

import catalog_actors
from catalog_records import key_of, plan, structure
from deltalake import DeltaTable
from deltalake.exceptions import TableNotFoundError

from upplied.catalog import compact, export_tables, open_catalog, verify
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store import opening
from upplied.errors import CatalogError

WRITERS = 8
READERS = 2


class Stage:
    """The processes, one per role and number; one that is killed is started again."""

    def __init__(self, place: Path) -> None:
        self.place = place
        self.context = multiprocessing.get_context("forkserver")
        # Imported once and forked, so that a process that is killed is soon replaced.
        self.context.set_forkserver_preload(
            [f"upplied.catalog.{name}" for name in ("database", "verbs.published", "verbs.maintenance")]
        )
        self.seeds = iter(range(1_000_000))
        self.running: dict[tuple[str, int], multiprocessing.Process] = {}
        self.kills: Counter[str] = Counter()

    def start(self, role: str, number: int) -> None:
        arguments = (role, str(self.place), next(self.seeds))
        process = self.context.Process(target=catalog_actors.act, args=arguments)
        process.start()
        self.running[role, number] = process

    def kill(self, role: str, number: int) -> None:
        process = self.running.pop((role, number))
        process.kill()
        process.join()
        self.kills[role] += 1
        self.start(role, number)

    def stop(self) -> None:
        (self.place / "stop").touch()
        for process in self.running.values():
            process.join(60)
            if process.is_alive():
                process.kill()
                process.join()


def chaos(place: Path, kills: int, every_s: float) -> Stage:
    """Let everybody work, and kill somebody who writes every so often."""
    rng = random.Random(kills)
    stage = Stage(place)
    open_catalog(place / "catalog").create()  # whoever publishes may be faster than whoever writes
    roles = [("writer", WRITERS), ("reader", READERS), ("publisher", 1), ("maintenance", 1)]
    try:
        for role, count in roles:
            for number in range(count):
                stage.start(role, number)
        begun = time.monotonic()
        while not list(place.glob("acknowledged-*")) and time.monotonic() < begun + 120:
            time.sleep(0.1)
        time.sleep(2)
        while sum(stage.kills.values()) < kills and not list(place.glob("trouble-*")):
            time.sleep(rng.uniform(0.2, 1.8) * every_s)
            who = rng.choice(["writer"] * 3 + ["publisher", "maintenance"])
            stage.kill(who, rng.randrange(WRITERS) if who == "writer" else 0)
        time.sleep(1)
    finally:
        stage.stop()
    return stage


@pytest.mark.parametrize(
    ("kills", "every_s"),
    [
        pytest.param(12, 0.35, id="12 kills", marks=pytest.mark.ci),
        pytest.param(200, 0.7, id="200 kills", marks=pytest.mark.slow),
    ],
)
def test_nothing_acknowledged_is_lost(tmp_path, capsys, kills, every_s):
    stage = chaos(tmp_path, kills, every_s)
    troubles = [path.read_text() for path in tmp_path.glob("trouble-*")]
    assert not troubles, troubles[0]
    catalog = open_catalog(tmp_path / "catalog")
    rows = catalog.transfers(every=True)
    notes = [path.read_text() for path in tmp_path.glob("acknowledged-*")]
    acknowledged = {key for note in notes for key in note.split("\n")[:-1]}
    times_stored = Counter(rows["key"])
    reads = [json.loads(path.read_text()) for path in tmp_path.glob("reads-*")]
    counts = {
        "kills": dict(stage.kills),
        "acknowledged": len(acknowledged),
        "lost": len(acknowledged - set(times_stored)),
        "twice": sum(count > 1 for count in times_stored.values()),
        "reads": sum(read["reads"] for read in reads),
        "published rows seen": max(read["published"] for read in reads),
    }
    with capsys.disabled():
        sys.stdout.write("\n   " + ", ".join(f"{name}: {value}" for name, value in counts.items()) + "\n")
    assert counts["lost"] == counts["twice"] == 0
    assert counts["acknowledged"] > kills
    assert counts["reads"] > 3
    assert sum(stage.kills.values()) == kills
    assert [each for each in verify(catalog) if "is not in" not in each.found] == []  # no structures here
    compact(catalog)
    assert export_tables(catalog, tmp_path / "reports")["transfers"] == len(times_stored)


def filled(place: Path) -> dict[str, int]:
    """A catalog with some plans; rows by table."""
    catalog = open_catalog(place)
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_plans([(key_of(at), plan("target", at), {}) for at in range(3)])
    export_tables(catalog, place.parent / "reports")
    return rows(place)


def rows(place: Path) -> dict[str, int]:
    catalog = open_catalog(place)
    return {name: len(catalog.tables[name].read()) for name in TABLES}


def in_a_child(body: str, place: Path, first: str = "") -> subprocess.CompletedProcess:
    """Run a few lines in a process of its own, under limits that it cannot shake off."""
    lines = [
        "import os, resource, signal, sys; sys.path.insert(0, sys.argv[1])",
        "from catalog_records import key_of, plan, structure",
        "from upplied.catalog import compact, export_tables, open_catalog",
        "from upplied.errors import CatalogError",
        "catalog = open_catalog(sys.argv[2])",
        first,
        f"try:\n    {body}",
        "except CatalogError as error:\n    sys.exit(f'told: {error}')",
    ]
    tests = str(Path(__file__).parents[1])
    return subprocess.run(
        [sys.executable, "-c", "\n".join(lines), tests, str(place)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


# No file may grow beyond a few kilobytes: what a full disk or a quota does to a writer. The signal is
# ignored, so that write() gives an error as it does there.
NO_SPACE = (
    "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000))"
)
NOBODY = "os.setuid(65534)"

WRITES = {
    "plans": "catalog.add_plans([(key_of('new', at), plan('target', at, 3000), {}) for at in range(20)])",
    "a structure": "catalog.add_structures([structure('big', landmarks={'n' * 30_000: (0, 0, 0)})])",
    "a publication": "export_tables(catalog, catalog.location + '/../reports')",
}


def files_of(place: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}


@pytest.mark.ci
@pytest.mark.parametrize("what", WRITES)
def test_a_full_disk_is_said_and_changes_nothing(tmp_path, what):
    filled(tmp_path / "catalog")
    open_catalog(tmp_path / "catalog").add_plans([(key_of("large"), plan("boxy", 9, 3000), {})])
    before = rows(tmp_path / "catalog")
    published = files_of(tmp_path / "reports")
    child = in_a_child(WRITES[what], tmp_path / "catalog", NO_SPACE)
    assert child.returncode == 1
    assert child.stderr.startswith("told: "), child.stderr
    assert "free" in child.stderr.lower()
    assert rows(tmp_path / "catalog") == before
    assert files_of(tmp_path / "reports") == published
    if what == "plans":
        assert in_a_child(WRITES[what], tmp_path / "catalog").returncode == 0  # with space again, it works
        assert rows(tmp_path / "catalog")["transfers"] == before["transfers"] + 20


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become somebody without rights")
@pytest.mark.parametrize("what", WRITES)
def test_a_read_only_folder_is_said_and_can_be_read(open_place, what):
    before = filled(open_place / "catalog")
    everyone_may_look(open_place)
    child = in_a_child(WRITES[what], open_place / "catalog", NOBODY)
    assert child.returncode == 1
    assert child.stderr.startswith("told: "), child.stderr
    assert rows(open_place / "catalog") == before
    read = in_a_child("assert len(catalog.waypoints(key_of(1)[:20])) == 60", open_place / "catalog", NOBODY)
    assert read.returncode == 0, read.stderr


@pytest.mark.ci
@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become somebody without rights")
def test_a_folder_that_may_not_be_read_is_not_taken_for_an_empty_one(open_place):
    filled(open_place / "catalog")
    everyone_may_look(open_place)
    (open_place / "catalog" / "transfers").chmod(0o700)
    child = in_a_child("catalog.transfers()", open_place / "catalog", NOBODY)
    assert child.stderr.startswith("told: "), child.stderr
    assert "transfers" in child.stderr


@pytest.fixture
def open_place() -> Iterator[Path]:
    """A folder that others may look into, which pytest's own are not."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


def everyone_may_look(place: Path) -> None:
    for path in place.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)


def test_a_file_in_the_place_of_the_folder_is_said(tmp_path):
    (tmp_path / "catalog").write_text("")
    with pytest.raises(CatalogError, match="catalog"):
        open_catalog(tmp_path / "catalog").add_plans([(key_of(0), plan(), {})])


@pytest.mark.slow
@pytest.mark.parametrize("count", [pytest.param(8, marks=pytest.mark.ci), 32])
def test_processes_that_read_end_well(tmp_path, count):
    """An abort at exit hits about one process in seven where it hits at all, so many are asked."""
    filled(tmp_path / "catalog")
    with ThreadPoolExecutor(4) as pool:
        children = list(
            pool.map(lambda _: in_a_child("catalog.transfers()", tmp_path / "catalog"), range(count))
        )
    assert [child.returncode for child in children] == [0] * count, children[0].stderr


def test_a_table_that_another_writer_makes_meanwhile_is_found(tmp_path, monkeypatch):
    open_catalog(tmp_path).add_structures([structure("a")])
    looked = []

    def late(*arguments):
        looked.append(arguments)
        if len(looked) == 1:  # what a look finds in the moment before the other's first commit
            raise TableNotFoundError("no log files")
        return DeltaTable(*arguments)

    monkeypatch.setattr(opening, "DeltaTable", late)
    assert list(open_catalog(tmp_path).structures()["structure_id"]) == ["a"]
    assert looked[0] == looked[1]
