"""How many small faults in the planning and the catalog do their tests notice?

First it is traced, once for each test file, which lines each test runs and what it costs. Mutants (`mutants`)
that no test runs are printed at once: a test is missing there, or the code is dead. Each other one meets the
tests that run its lines, first those of its own room and of them the fastest, until one fails. A line that is
run when a module is loaded, or in a compiled function, counts as run by every test that runs any line of its
module. Times are those of the processor, so that a busy machine judges as a quiet one does. Printed are the
share that the tests killed, and each survivor.

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
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from mutants import ROOMS, ROOT, Mutant, sample

SLACK_S = 30  # beyond three times what the tests take on sound code: then a mutant hangs, which is noticed
WAITS = 12  # times that, by the clock: then it waits for something that does not come
HANGS_S = 600  # after which a file of tests is given up that is being traced
BUDGET_S = 60  # of tests for one mutant, as they take on sound code; what survives them counts as survived
CALLS, LINES = 200, 20_000  # of one function in one test: what it runs beyond is no longer traced
KEPT = ROOT / ".cache" / "mutate.json"
#: Loaded once, and not anew for each mutant; not pyarrow, which starts threads that do not survive a fork.
LIBRARIES = (
    "pytest", "hypothesis", "numpy", "scipy.optimize", "scipy.spatial", "scipy.interpolate", "scipy.sparse",
    "numba", "open3d",
)  # fmt: skip

Lines = dict[str, dict[str, list[str]]]  # of a module, of a line: who runs it


class Tracer:
    """A plugin of pytest: which lines of the rooms each test runs, and the seconds that it takes."""

    def __init__(self, root: Path) -> None:
        self._inside = tuple(str(root / room) + os.sep for room in ROOMS)
        self._root, self._who, self._begin = root, "", 0.0
        self._seen = set[tuple[CodeType, str, int]]()
        self._asked: dict[CodeType, bool] = {}
        self._calls, self._lines = Counter[CodeType](), Counter[CodeType]()
        self.seconds: dict[str, float] = {}
        self.failed: list[str] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        # What a fixture runs may be meant for all tests of the file.
        self._ask(nodeid.split("::")[0])
        self._begin = time.process_time()
        sys.settrace(self._enter)

    def pytest_runtest_call(self, item: Any) -> None:
        self._ask(item.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        sys.settrace(None)
        self.seconds[nodeid] = time.process_time() - self._begin

    def _ask(self, who: str) -> None:
        self._who = who
        self._calls.clear()
        self._lines.clear()

    def _enter(self, frame: FrameType, event: str, argument: object) -> Any:
        code = frame.f_code
        asked = self._asked.get(code)
        if asked is None:
            asked = code.co_filename.startswith(self._inside) and code.co_name != "<module>"
            self._asked[code] = asked
        if not asked:
            return None
        self._calls[code] += 1
        return self._line if self._calls[code] <= CALLS else None

    def _line(self, frame: FrameType, event: str, argument: object) -> Any:
        code = frame.f_code
        if event == "line":
            self._lines[code] += 1
            self._seen.add((code, self._who, frame.f_lineno))
        return self._line if self._lines[code] < LINES else None

    def lines(self) -> Lines:
        """Of each module and line, who runs it: a test, or by its name alone the file of tests."""
        found: Lines = {}
        for code, who, line in self._seen:
            module = str(Path(code.co_filename).relative_to(self._root))
            found.setdefault(module, {}).setdefault(str(line), []).append(who)
        return found


def _pytest(root: Path, asked: list[str], plugins: list[object]) -> int:
    """In a process of its own: the tests on a copy of the project."""
    import pytest

    os.chdir(root)
    sys.path[:0] = [str(root), str(root / "tests")]
    sys.dont_write_bytecode = True
    os.environ |= {"PYTHONPATH": f"{root}:{root / 'tests'}", "PYTHONDONTWRITEBYTECODE": "1"}
    os.environ.setdefault("UPPLIED_REAL_DATA", str(ROOT.parent / "shared" / "data"))
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    options = ["-q", "-m", "not slow", "-p", "no:cacheprovider"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of what is loaded already
    return int(pytest.main([*options, *asked], plugins=plugins))


def _trace(root: Path, file: str, result: Path) -> None:
    tracer = Tracer(root)
    _pytest(root, [file], [tracer])
    sound = {name: lasts for name, lasts in tracer.seconds.items() if name not in tracer.failed}
    found = {"seconds": sound, "failed": tracer.failed, "lines": tracer.lines()}
    result.write_text(json.dumps(found), encoding="utf-8")


def _judge(root: Path, asked: list[str], limit_s: int) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    os._exit(min(_pytest(root, ["-x", *asked], []), 1))


def traced(root: Path, rooms: tuple[str, ...]) -> dict[str, Any]:
    """Who runs which line, of every test file; what was traced of the same code and tests is kept."""
    sources = _digest(root, *sorted((root / "upplied").rglob("*.py")))
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    found = kept.get("files", {}) if kept.get("sources") == sources else {}
    folders = {_tests_of(root, Path(room)) for room in rooms}
    for path in sorted(path for folder in folders for path in folder.rglob("test_*.py")):
        file, digest = str(path.relative_to(root)), _digest(root, path)
        if found.get(file, {}).get("digest") == digest:
            continue
        begin, result = time.monotonic(), root / "traced.json"
        result.unlink(missing_ok=True)
        process = CONTEXT.Process(target=_trace, args=(root, file, result))
        process.start()
        process.join(HANGS_S)
        if process.is_alive() or not result.exists():
            process.kill()
            process.join()
            print(f"{file} hangs or crashes, and is not asked", flush=True)
            continue
        found[file] = json.loads(result.read_text(encoding="utf-8")) | {"digest": digest}
        failed = "".join(f"; fails on sound code, and is not asked: {name}" for name in found[file]["failed"])
        print(f"traced {file} in {time.monotonic() - begin:.0f} s{failed}", flush=True)
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps({"sources": sources, "files": found}), encoding="utf-8")
    return found


def _tests_of(root: Path, room: Path) -> Path:
    """The folder of tests of a room, or of the nearest room around it that has tests."""
    folder = root / "tests" / room.relative_to("upplied").with_suffix("")
    while not any(folder.glob("test_*.py")) and folder != root / "tests" / room.parts[1]:
        folder = folder.parent
    return folder


def _digest(root: Path, *paths: Path) -> str:
    whole = hashlib.sha256()
    for path in paths:
        whole.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()


def tests_for(mutant: Mutant, files: dict[str, Any], own: str) -> list[tuple[str, float]]:
    """The tests that run a mutant's lines, and their seconds: those under `own` first, then the fastest."""
    asked: dict[str, float] = {}
    for file, of in files.items():
        run, seconds = of["lines"].get(str(mutant.path), {}), of["seconds"]
        who = set()
        for line, names in run.items():
            if not mutant.traced or int(line) in mutant.lines:
                who.update(names)
        asked |= seconds if file in who else {name: seconds[name] for name in who & seconds.keys()}
    return sorted(asked.items(), key=lambda each: (not each[0].startswith(own), each[1]))


def within_budget(asked: list[tuple[str, float]]) -> tuple[list[str], float]:
    """The first of the tests that keep to the budget, at least one, and their seconds."""
    names, seconds = [], 0.0
    for name, lasts in asked:
        if not names or seconds + lasts <= BUDGET_S:
            names.append(name)
            seconds += lasts
    return names, seconds


def noticed(mutant: Mutant, asked: list[str], seconds: float, root: Path) -> bool:
    """Whether a test fails on the mutant; hanging is failing."""
    place = root / mutant.path
    sound, times = place.read_text(encoding="utf-8"), place.stat()
    place.write_text(mutant.source, encoding="utf-8")
    limit_s = int(3 * seconds + SLACK_S)
    try:
        _forget_compiled(place, root)
        process = CONTEXT.Process(target=_judge, args=(root, asked, limit_s))
        process.start()
        process.join(WAITS * limit_s)
        if process.is_alive():
            process.kill()
            process.join()
            return True
        return process.exitcode != 0
    finally:
        place.write_text(sound, encoding="utf-8")
        os.utime(place, ns=(times.st_atime_ns, times.st_mtime_ns))  # what was compiled of it holds again
        _forget_compiled(place, root)


def _forget_compiled(place: Path, root: Path) -> None:
    """Compiled functions may hold copies of a module's: numba does not compile them anew for it."""
    if "njit" not in place.read_text(encoding="utf-8"):
        return
    name = ".".join(place.relative_to(root).with_suffix("").parts)
    for module in root.joinpath("upplied").rglob("*.py"):
        if module == place or name in module.read_text(encoding="utf-8"):
            for index in module.parent.joinpath("__pycache__").glob(f"{module.stem}.*.nbi"):
                index.unlink()


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=ROOMS, help="rooms or modules, asked by their own tests")
    parser.add_argument("--skip", type=int, default=0, help="of the drawn ones, those already judged")
    parser.add_argument("--hours", type=float, default=24.0, help="after which no further mutant is judged")
    given = parser.parse_args()
    mutants, begin = sample(given.number, given.seed, tuple(given.only)), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "project"
        ignored = shutil.ignore_patterns(".venv", ".git", "*.pyc", ".*_cache", ".cache", "site")
        shutil.copytree(ROOT, root, ignore=ignored, symlinks=True)
        files = traced(root, tuple(given.only))
        judged, survivors = 0, []
        asks = [
            tests_for(mutant, files, f"{_tests_of(root, mutant.path.parent).relative_to(root)}/")
            for mutant in mutants
        ]
        for number in sorted(range(given.skip, len(mutants)), key=lambda at: bool(asks[at])):
            if time.monotonic() - begin > 3600 * given.hours:
                break
            mutant, (asked, seconds) = mutants[number], within_budget(asks[number])
            judged += 1
            if asked and noticed(mutant, asked, seconds, root):
                said = "killed"
            else:
                said = "SURVIVED" if asked else "RUN BY NO TEST"
                survivors.append(f"{mutant} ({len(asked)} of {len(asks[number])} tests)")
            print(f"{number:4d} {said:14s} {mutant}", flush=True)
    share = 100 * (1 - len(survivors) / max(judged, 1))
    print(f"\n{judged - len(survivors)} of {judged} mutants killed: {share:.0f} % (seed {given.seed})")
    for survivor in survivors:
        print(f"survived: {survivor}")
    return 0


if __name__ == "__main__":
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    CONTEXT = multiprocessing.get_context("forkserver")
    CONTEXT.set_forkserver_preload(list(LIBRARIES))
    raise SystemExit(main())
