"""`upplied samples`, `quickstart` and `doctor`: a sample fleet, all steps, and checks of this machine."""

import os
import platform
import shlex
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import HERE, PRINTED, Results, Where, errors, number, progress, say

PRESETS = ("paper", "recommended", "baseline")
_INSTALL = "install from requirements-runtime.lock, as make quickstart does"
samples = App(name="samples", help="Write a sample fleet to try.")


@samples.command
def write(folder: Path = Path("samples")) -> int:
    """Write meshes, their manifest and a simulated pilot's logs.

    Parameters
    ----------
    folder : Path
        Folder to write to; it is created if it is missing.
    """
    _write_samples(folder)
    say(f"{folder / 'structures.toml'} and its logs")
    HERE.next_step(f"structures add {shlex.quote(str(folder / 'structures.toml'))}", "import the meshes")
    return 0


def _write_samples(folder: Path) -> None:
    from upplied.outputs.sample_fleet import FILES, write_sample_fleet

    with progress("files", FILES) as advance:
        write_sample_fleet(folder, lambda _: advance())


def quickstart(folder: Path = Path(".")) -> int:
    """Plan a sample fleet from log to report.

    Every demonstration is transferred to every structure of its kind.

    Parameters
    ----------
    folder : Path
        Folder for samples, catalog and reports.
    """
    from upplied import fleet, open_catalog
    from upplied.cli.serve import pairs_in
    from upplied.cli.transfer import run
    from upplied.fleet.ingest import find_logs
    from upplied.inputs.manifests import read_manifest

    samples, reports = folder / "samples", folder / "reports"
    say("1/4 Writing a sample fleet: meshes, a manifest and simulated logs")
    _write_samples(samples)
    catalog = open_catalog(folder / "catalog")
    say("2/4 Importing structures and demonstrations")
    with progress("structures", len(read_manifest(samples / "structures.toml"))) as advance:
        fleet.ingest_structures(catalog, samples / "structures.toml", progress=lambda _: advance())
    logs = find_logs([samples])
    with progress("demonstrations", len(logs)) as advance:
        fleet.ingest_demonstrations(catalog, logs, progress=lambda _: advance())
    say("3/4 Planning every demonstration for every structure of its kind")
    result = run(catalog, fleet.decide(catalog, fleet.PlanRequest(PRESETS)), 0, 600.0)
    say("4/4 Publishing tables, pages and pictures")
    with progress("publishing", pairs_in(catalog)) as advance:
        fleet.publish(catalog, reports, progress=lambda _: advance())
    say(f"Plans: {result}")
    return show_results(folder / "catalog", str(reports))


def show_results(catalog: Path, reports: str) -> int:
    from upplied import open_catalog

    transfers = open_catalog(catalog).transfers()
    rows = []
    for (demonstration, target), plans in transfers.groupby(["demonstration_id", "target_id"]):
        row, by = {"demonstration": demonstration, "structure": target}, plans.set_index("preset")
        for preset in PRESETS:
            shown = number(by["coverage_inspected_pct"].get(preset))
            row[f"{preset} %"] = by["status"].get(preset) if shown is None else shown
        rows.append(row | {f"Fréchet {preset}": by["frechet_z"].get(preset) for preset in PRESETS[:2]})
    PRINTED.show("inspected surface shown", rows)
    say(f"Open {reports}/index.html, or: pd.read_parquet('{reports}/transfers.parquet')")
    return int((transfers["status"] == "failed").any())


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
    wrong = []
    for name, bound in {"sqlalchemy": (2, 1), "fastapi": (0, 151)}.items():
        if tuple(map(int, version(name).split(".")[:2])) >= bound:
            wrong.append(f"{name} {version(name)} (needs < {bound[0]}.{bound[1]})")
    if wrong:
        raise RuntimeError(f"{', '.join(wrong)}: {_INSTALL}")
    return f"upplied {version('upplied')}, prefect {version('prefect')}, {_open3d_version()}"


def _open3d_version() -> str:
    for name in ("open3d-cpu", "open3d"):
        with suppress(PackageNotFoundError):
            return f"open3d {version(name)}"
    return 'no planning (pip install "upplied[plan]")'


def _open3d() -> str:
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
    counts = f"{len(store.structures())} structures, {len(store.demonstrations())} demonstrations"
    return f"{store.location}: {counts}"
