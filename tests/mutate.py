"""How many small faults in the planning and the catalog do their tests notice?

First it is traced, once for each test file, which lines each test runs and what it costs (`tracing`).
Each mutant (`mutants`) meets the tests that run its lines, those of its own module and room first, and of
them the fastest, until one fails; where none runs it, a test is missing, or the code is dead. Printed are the
share that the tests killed, and each survivor. Verdicts are kept as they come: a run that is broken off goes
on where it was, and what killed a mutant is asked first the next time. Mutants come in the order in which
they were drawn, so that a part of a run tells as much as a smaller run.

    python tests/mutate.py --number 200 --seed 0 [--only upplied/planning/airspace]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import resource
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from mutants import ROOMS, ROOT, Mutant, sample
from tracing import digest, of_tests, run_tests, tests_for, traced

SLACK_S = 30  # beyond three times what the tests take on sound code: then a mutant hangs, which is noticed
COMPILED_S = 120  # as much again, for what is compiled anew of a mutant
WAITS = 12  # times that, by the clock: then it waits for something that does not come
LOADED_S = 1.0  # for each file of tests
BUDGET_S = 12  # of tests for one mutant, as they take traced on sound code; then it counts as survived
VERDICTS = ROOT / ".cache" / "mutate" / "verdicts.json"
#: Loaded once, and not anew for each mutant; not pyarrow, which starts threads that do not survive a fork.
LIBRARIES = (
    "pytest", "hypothesis", "numpy", "scipy.optimize", "scipy.spatial", "scipy.interpolate", "scipy.sparse",
    "numba", "open3d", "coverage",
)  # fmt: skip
TIMEOUT = "the time limit"


class FirstFailure:
    """A plugin of pytest that writes down which test failed first."""

    def __init__(self, place: Path) -> None:
        self._place = place

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self._place.exists():
            self._place.write_text(report.nodeid, encoding="utf-8")

    def pytest_collectreport(self, report: Any) -> None:
        self.pytest_runtest_logreport(report)


def _judge(root: Path, names: list[str], limit_s: int, place: Path) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    os._exit(min(run_tests(root, ["-x", *names], [FirstFailure(place)]), 1))


def within_budget(tests: list[tuple[str, float]], first: str) -> tuple[list[str], float]:
    """The first of the tests that keep to the budget, at least one, and their seconds; `first` leads."""
    names, seconds, files = [], 0.0, set[str]()
    for name, lasts in sorted(tests, key=lambda each: each[0] != first):
        file = name.split("::")[0]
        costs = lasts + LOADED_S * (file not in files)
        if not names or seconds + costs <= BUDGET_S:
            names.append(name)
            files.add(file)
            seconds += costs
    return names, seconds


def killed_by(mutant: Mutant, names: list[str], seconds: float, root: Path) -> str:
    """The first test that fails on the mutant, or the time limit if it hangs; nothing if it survives."""
    place, file = root / mutant.path, root / "failed.txt"
    sound, times = place.read_text(encoding="utf-8"), place.stat()
    file.unlink(missing_ok=True)
    place.write_text(mutant.source, encoding="utf-8")
    try:
        compiled = _forget_compiled(place, root)
        limit_s = int(3 * seconds + SLACK_S + COMPILED_S * compiled)
        process = CONTEXT.Process(target=_judge, args=(root, names, limit_s, file))
        process.start()
        process.join(WAITS * limit_s)
        if process.is_alive():
            process.kill()
            process.join()
            return TIMEOUT
        if process.exitcode == 0:
            return ""
        return file.read_text(encoding="utf-8") if file.exists() else TIMEOUT
    finally:
        place.write_text(sound, encoding="utf-8")
        os.utime(place, ns=(times.st_atime_ns, times.st_mtime_ns))  # what was compiled of it holds again
        _forget_compiled(place, root)


def _forget_compiled(place: Path, root: Path) -> bool:
    """Compiled functions may hold copies of a module's: numba does not compile them anew for it."""
    if "njit" not in place.read_text(encoding="utf-8"):
        return False
    name = ".".join(place.relative_to(root).with_suffix("").parts)
    for module in root.joinpath("upplied").rglob("*.py"):
        if module == place or name in module.read_text(encoding="utf-8"):
            for index in module.parent.joinpath("__pycache__").glob(f"{module.stem}.*.nbi"):
                index.unlink()
    return True


def _copied() -> Path:
    """A copy of the project that faults are written into; what numba compiled for an earlier one is kept."""
    root = Path(tempfile.gettempdir()) / f"mutate-{hashlib.sha256(str(ROOT).encode()).hexdigest()[:12]}"
    if root.exists():
        for place in root.rglob("*"):
            if place.is_file() and place.parent.name != "__pycache__":
                place.unlink()
    ignored = shutil.ignore_patterns(".venv", ".git", "__pycache__", ".*_cache", ".cache", "site")
    shutil.copytree(ROOT, root, ignore=ignored, symlinks=True, dirs_exist_ok=True)
    return root


class Verdicts:
    """What was judged, and of which sources and tests; kept on disk as it comes."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._known = json.loads(VERDICTS.read_text(encoding="utf-8")) if VERDICTS.exists() else {}
        self._sources = digest(root, *sorted((root / "upplied").rglob("*.py")))

    def known(self, mutant: Mutant, names: list[str]) -> tuple[str | None, str]:
        """The verdict if it still holds, else None; and what killed the mutant when it was judged last."""
        of = self._known.get(_key(mutant))
        if of is None:
            return None, ""
        holds = of["of"] == self._of(names, of["by"])
        return of["by"] if holds else None, of["by"]

    def keep(self, mutant: Mutant, names: list[str], by: str) -> None:
        self._known[_key(mutant)] = {"mutant": str(mutant), "by": by, "of": self._of(names, by)}
        VERDICTS.parent.mkdir(parents=True, exist_ok=True)
        VERDICTS.write_text(json.dumps(self._known, indent=1), encoding="utf-8")

    def _of(self, choice: list[str], by: str) -> str:
        """The digest of what a verdict rests on: one test if it failed, else all that were asked."""
        names = [by] if "::" in by else choice
        files = {self._root / name.split("::")[0] for name in names}
        tests = sorted({path for file in files if file.exists() for path in of_tests(self._root, file)})
        return hashlib.sha256(
            "\0".join([self._sources, digest(self._root, *tests), *names]).encode()
        ).hexdigest()


def _key(mutant: Mutant) -> str:
    return hashlib.sha256(f"{mutant.path}\0{mutant.source}".encode()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=ROOMS, help="rooms or modules, asked by their own tests")
    parser.add_argument("--hours", type=float, default=24.0, help="after which no further mutant is judged")
    options = parser.parse_args()
    mutants, begin = sample(options.number, options.seed, tuple(options.only)), time.monotonic()
    root = _copied()
    files, verdicts = traced(root, tuple(options.only), CONTEXT), Verdicts(root)
    asks = [tests_for(mutant, files, root) for mutant in mutants]
    judged, survivors, late = 0, [], 0
    for number, (mutant, could) in enumerate(zip(mutants, asks, strict=True)):
        by, before = verdicts.known(mutant, within_budget(could, "")[0])
        names, seconds = within_budget(could, before)
        if by is None and time.monotonic() - begin > 3600 * options.hours:
            break
        judged += 1
        start = time.monotonic()
        if by is None:
            by = killed_by(mutant, names, seconds, root) if names else ""
            verdicts.keep(mutant, within_budget(could, "")[0], by)
        late += by == TIMEOUT
        outcome = f"killed by {by}" if by else f"SURVIVED {len(names)} of {len(could)} tests"
        if not by:
            survivors.append(f"{mutant} ({len(names)} of {len(could)} tests)")
        print(f"{number:4d} {mutant} {outcome} in {time.monotonic() - start:.0f} s", flush=True)
    killed = judged - len(survivors)
    print(
        f"\n{killed} of {judged} mutants killed: {100 * killed / max(judged, 1):.0f} % (seed {options.seed})"
    )
    print(f"of them {late} by {TIMEOUT}")
    for survivor in survivors:
        print(f"survived: {survivor}")
    return 0


if __name__ == "__main__":
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    CONTEXT = multiprocessing.get_context("forkserver")
    CONTEXT.set_forkserver_preload(list(LIBRARIES))
    raise SystemExit(main())
