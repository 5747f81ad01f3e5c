"""`upplied serve`, `deploy`, `watch`, `fleet` and `doctor`: a fleet by Prefect, and this machine."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from upplied.cli.terminal import PRINTED, Results, Where, complain, errors, say
from upplied.extras import extra

fleet = App(name="fleet", help="The fleet's deployments in Prefect.")

PortOption = Annotated[
    int,
    Parameter(
        name="--port",
        env_var="UPPLIED_PORT",
        help="Port of Prefect, 0 for any; the pages use the next one.",
        validator=Number(gte=0, lte=65534),
    ),
]
RootOption = Annotated[
    tuple[str, ...], Parameter("--root", help="Further folder or URI for runs; repeatable.")
]
FlightsOption = Annotated[bool, Parameter(help="The logs are flights of plans: start ingest-flights.")]
PartOption = Annotated[
    Literal["server", "worker", "reports"] | None,
    Parameter(name="--only", help="Run one part only, for systemd or compose."),
]
_INSTALL = "install from requirements-runtime.lock, as make quickstart does"


def serve(*, port: PortOption = 4200, root: RootOption = (), only: PartOption = None) -> int:
    """Run the fleet service of this folder: Prefect, a worker and the pages, until Ctrl-C."""
    require_flows()
    from upplied.flows import serve as service
    from upplied.flows.server import ServerError

    try:
        return service.only(only, port, root) if only else service.serve(port, root)
    except ServerError as error:
        complain(error)
        return 1


def deploy(*, port: PortOption = 4200) -> int:
    """Apply the deployments to the Prefect server: prefect.yaml of this folder, or the program's own."""
    if not (variables := connected(port)):
        return 1
    from upplied.flows import serve
    from upplied.flows.server import ServerError

    try:
        serve.deploy(variables)
    except ServerError as error:
        complain(error)
        return 1
    return 0


def watch(folder: Path, *, flights: FlightsOption = False, port: PortOption = 4200) -> int:
    """Report each new log in a folder to Prefect, which starts ingest-demonstrations for it.

    Parameters
    ----------
    folder : Path
        Folder to watch with its subfolders; existing logs are reported too.
    """
    if not folder.is_dir():
        complain(f"error: {folder} is not a folder")
        return 2
    if not connected(port):
        return 1
    from upplied.flows.watch import FLOWN, LANDED
    from upplied.flows.watch import watch as tell

    tell(folder, FLOWN if flights else LANDED)
    return 0


@fleet.command
def run(
    *parameters: Annotated[str, Parameter(allow_leading_hyphen=False)],
    watch: Annotated[bool, Parameter(negative="--no-watch", help="Follow the run until it ends.")] = True,
    port: PortOption = 4200,
) -> int:
    """Run transfer-fleet now, on the server at PREFECT_API_URL, else the one of `upplied serve`.

    Parameters
    ----------
    parameters : str
        Parameters of the flow, as NAME=VALUE with the value in JSON.
    """
    if not (variables := connected(port)):
        return 1
    from upplied.flows.pool import NotAccepted, run_now

    try:
        ended = run_now(parameters, watch, say)
    except NotAccepted as error:
        complain(f"error: {variables['PREFECT_API_URL']}: {error}")
        return 1
    return int(not ended)


@fleet.command
def notify(
    url: str,
    *,
    every_run: Annotated[bool, Parameter(help="Report successful runs as well.")] = False,
    port: PortOption = 4200,
) -> int:
    """Send a message whenever a run fails, is lost or leaves failures; a new address replaces the old one.

    Parameters
    ----------
    url : str
        Address: a webhook (http://...), Slack (https://hooks.slack.com/...), or any Apprise address,
        as mailto://user:password@smtp.example.org?to=ops@example.org. Empty: no more messages.
    """
    if not connected(port):
        return 1
    from upplied.flows.automations import tell

    say(tell(url, every_run))
    return 0


def require_flows() -> None:
    """Report what to install if the flows are missing."""
    with extra("fleet"):
        if find_spec("prefect") is None:
            raise ModuleNotFoundError(name="prefect")


def connected(port: int) -> dict[str, str]:
    """The variables of the server, set for Prefect; empty, after a message, if no server answers."""
    require_flows()
    from upplied.flows import environment
    from upplied.flows.server import answers

    variables = environment.client(port)
    os.environ.update(variables)  # before Prefect is loaded, which reads it once
    if answers(address := variables["PREFECT_API_URL"]):
        return variables
    remedy = "Start one (`upplied serve`), or set PREFECT_API_URL to the address of yours."
    complain(f"error: no Prefect server answers at {address}. {remedy}")
    return {}


def doctor(*, results: Results = PRINTED) -> int:
    """Check that this machine can do the work, and report what is missing."""
    checks: dict[str, Callable[[], str]] = {
        "system": _system,
        "Python": lambda: f"{sys.version.split()[0]} at {sys.executable}",
        "packages": _packages,
        "Open3D": _open3d,
        "numba": _numba,
        "memory": _memory,
        "disk": _disk,
        "catalog": lambda: _catalog(results),
    }
    with errors.status("checking"):
        rows = [{"check": name, **_tried(check)} for name, check in checks.items()]
    results.show("doctor", rows)
    return int(any(row["result"] == "bad" for row in rows))


def _tried(check: Callable[[], str]) -> dict[str, str]:
    try:
        return {"result": "good", "details": check()}
    except ModuleNotFoundError as error:  # a package's metadata is missing with the same error
        return {"result": "bad", "details": f"{error.name} is not installed: {_INSTALL}"}
    except Exception as error:
        return {"result": "bad", "details": f"{error}"}


def _system() -> str:
    """The ray caster's wheels need a recent C library."""
    name, release = platform.libc_ver()
    if name == "glibc" and tuple(map(int, release.split(".")[:2])) < (2, 35):
        raise RuntimeError(f"glibc {release} (needs 2.35): use Debian 12, Ubuntu 22.04 or newer")
    return f"{platform.system()} {platform.machine()}, {name or 'libc'} {release}".strip()


def _packages() -> str:
    """Prefect breaks silently with newer versions of these; a locked install has the right ones."""
    if find_spec("prefect") is None:
        flows = 'no flows (pip install "upplied[fleet]")'
        return f"upplied {version('upplied')}, {_open3d_version()}, {flows}"
    bounds = {"sqlalchemy": (2, 1), "fastapi": (0, 151)}
    wrong = [
        f"{name} {version(name)} (needs < {bound[0]}.{bound[1]})"
        for name, bound in bounds.items()
        if tuple(map(int, version(name).split(".")[:2])) >= bound
    ]
    if wrong:
        raise RuntimeError(f"{', '.join(wrong)}: {_INSTALL}")
    return f"upplied {version('upplied')}, prefect {version('prefect')}, {_open3d_version()}"


def _open3d_version() -> str:
    for name in ("open3d-cpu", "open3d"):
        with suppress(PackageNotFoundError):
            return f"open3d {version(name)}"
    return 'no planning (pip install "upplied[plan]")'


def _open3d() -> str:
    """One ray that must hit."""
    import numpy as np

    from upplied.geometry.scene import Scene

    corners = np.array([[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 2.0]])
    scene = Scene(corners, np.array([[0, 1, 2]]))
    hit = scene.occluded(np.array([[-1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    if not hit.all():
        raise RuntimeError("a ray went through a triangle: the ray caster does not work on this processor")
    return "casts rays"


def _numba() -> str:
    import numba

    if numba.njit(lambda number: number + 1)(1) != 2:
        raise RuntimeError("compiled code gives wrong results: reinstall numba and llvmlite")
    return f"{numba.__version__} compiles"


def _memory() -> str:
    gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    if gib < 3:
        raise RuntimeError(f"{gib:.1f} GiB; each worker needs about 1.5 GiB: use --workers 1")
    return f"{gib:.0f} GiB, {os.cpu_count()} cores"


def _disk() -> str:
    free = shutil.disk_usage(".").free / 2**30
    if free < 1:
        raise RuntimeError(f"{free:.1f} GiB free here; the caches of a small fleet need 1 GiB")
    return f"{free:.0f} GiB free"


def _catalog(where: Where) -> str:
    store = where.opened()
    structures, demonstrations = len(store.structures()), len(store.demonstrations())
    return f"{store.location}: {structures} structures, {demonstrations} demonstrations"
