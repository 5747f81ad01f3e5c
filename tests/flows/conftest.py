"""The server and the fleet of each module."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from flow_runs import close_sessions
from random_members import random_member

from upplied.catalog import open_catalog
from upplied.flows.server import Server
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@pytest.fixture(scope="session")
def database(tmp_path_factory) -> Path:
    """A server's database, made once a run: that takes longer than all else of a server's start."""
    own = tmp_path_factory.getbasetemp()
    path = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "database" / "prefect.db"
    path.parent.mkdir(exist_ok=True)
    with (path.parent / "making").open("w") as making:
        fcntl.flock(making, fcntl.LOCK_EX)
        if not path.exists():
            with Server(tmp_path_factory.mktemp("first")) as server:
                server.wait()
            shutil.copy(server.log.parent / path.name, path.with_suffix(".new"))  # with who may read it
            path.with_suffix(".new").rename(path)
    return path


@pytest.fixture(scope="module")
def server(tmp_path_factory, database) -> Iterator[Server]:
    """A server of one module's own: waiting for tests of others costs more than a start."""
    folder = tmp_path_factory.mktemp("prefect")
    shutil.copy(database, folder / database.name)
    with Server(folder) as server:
        server.wait()
        yield server


@pytest.fixture(scope="module", autouse=True)
def sessions() -> Iterator[None]:
    """What runs code for the tests of a module ends with it."""
    yield
    close_sessions()


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with a catalog of a cube and two boxes, and a log that is not in it yet."""
    place = tmp_path_factory.mktemp("place")
    cube = member("cube-v1").structure
    open_catalog(place / "catalog").add_structures(
        [cube, *(random_member("box", n).structure for n in (1, 2))]
    )
    write_log(place / "flight.mcap", fly(cube, "sides"), cube)
    return place
