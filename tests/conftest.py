"""What all tests share: where real structures and flights lie, and the ones we make ourselves."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy is loaded: on small matrices more threads than one only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples everywhere, however busy a machine is.
settings.register_profile("tests", deadline=None, derandomize=True)
settings.load_profile("tests")

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "bench"))  # random members, true counterparts


def pytest_configure() -> None:
    """A run that is told to end leaves as on Ctrl-C: what its tests started is stopped."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by what a script started with &


def pytest_itemcollected(item: pytest.Item) -> None:
    """What is for the continuous integration is slow; a case that is marked slow itself is not for it."""
    case = getattr(item, "callspec", None)
    if case and any(mark.name == "slow" for mark in case.marks):
        item.own_markers[:] = [mark for mark in item.own_markers if mark.name != "ci"]
    if item.get_closest_marker("ci"):
        item.add_marker("slow")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """What tests of all rooms share, but for those that are marked `anew` or patch the program themselves."""
    if "upplied.planning.plan" in sys.modules:
        import remembered

        fixtures = getattr(item, "_fixtureinfo", None)
        anew = item.get_closest_marker("anew") or (fixtures and "monkeypatch" in fixtures.argnames)
        remembered.share(bool(anew), but_study="planning" in item.path.parts)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with many tests of whole plans begin, those of servers soon among them: these mostly wait."""
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    waiting = [own for own in files.values() if any(item.get_closest_marker("server") for item in own)]
    order = [own for own in files.values() if own not in waiting]
    order.sort(key=lambda own: -sum(item.get_closest_marker("ci") is not None for item in own))
    apart = max(1, len(order) // (8 * len(waiting) or 1))
    for number, own in enumerate(waiting):
        order.insert(number * (apart + 1), own)
    items[:] = [item for own in order for item in own]


@pytest.fixture(scope="session", autouse=True)
def no_wait_for_the_disk() -> Iterator[None]:
    """No test cuts the power: nobody waits until a disk has what was written, 8 ms each time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def workers_are_forked() -> Iterator[None]:
    """Workers of a fleet start at once; tests of the workers themselves put `forked.AS_IT_IS` back."""
    import forked

    forked.prepare()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forked.workers, "_Context", forked.Context)
        yield


@pytest.fixture(autouse=True)
def own_environment() -> Iterator[None]:
    """Commands of ours that serve or run a fleet set variables for this process: no test sees another's."""
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder with `meshes/` and `logs/` of real structures and flights; tests skip where it is absent.

    Set UPPLIED_REAL_DATA to read another folder. The files carry other people's licences, so they
    are not part of this project.
    """
    folder = Path(os.environ.get("UPPLIED_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "meshes").is_dir():
        pytest.skip(f"no real structures at {folder}; set UPPLIED_REAL_DATA to a folder that has them")
    return folder
