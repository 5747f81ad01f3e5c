"""Which lines of planning and catalog each test runs, and what it costs, for `mutate`.

A line that is run when a module is loaded, or in a compiled function, counts as run by every test that runs
any line of its module, and after these by every test that loads it. Times are those of the processor, so that
a busy machine judges as a quiet one does.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any

from coverage import Coverage
from mutants import ROOMS, ROOT, Mutant

HANGS_S = 900  # after which a file of tests is given up that is being traced
TRACES = ROOT / ".cache" / "mutate" / "traced.json"

Lines = dict[str, dict[str, list[str]]]  # of a module, of a line: who runs it


class Tracer:
    """A plugin of pytest: which lines of the rooms each test runs, and the seconds that it takes."""

    def __init__(self, root: Path) -> None:
        self._measured = Coverage(
            data_file=None, config_file=False, include=[str(root / room / "*") for room in ROOMS]
        )
        self._root, self._begin = root, 0.0
        self.seconds: dict[str, float] = {}
        self.failed: list[str] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._measured.start()
        # What a fixture runs may be meant for all tests of the file.
        self._measured.switch_context(nodeid.split("::")[0])
        self._begin = time.process_time()

    def pytest_runtest_call(self, item: Any) -> None:
        self._measured.switch_context(item.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.seconds[nodeid] = time.process_time() - self._begin
        self._measured.stop()

    def lines(self) -> Lines:
        """Of each module and line, who runs it: a test, or by its name alone the file of tests."""
        data = self._measured.get_data()
        return {
            str(Path(name).relative_to(self._root)): {
                str(line): who for line, who in data.contexts_by_lineno(name).items()
            }
            for name in data.measured_files()
        }


def run_tests(root: Path, tests: list[str], plugins: list[object]) -> int:
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
    options = ["-q", "-m", "not slow or ci", "-p", "no:cacheprovider"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of what is loaded already
    return int(pytest.main([*options, *tests], plugins=plugins))


def _trace(root: Path, file: str, result: Path) -> None:
    tracer = Tracer(root)
    run_tests(root, [file], [tracer])
    sound = {name: lasts for name, lasts in tracer.seconds.items() if name not in tracer.failed}
    ours = str(root / "upplied") + os.sep
    places = {Path(at) for at in (getattr(each, "__file__", None) for each in sys.modules.values()) if at}
    loaded = sorted(str(place.relative_to(root)) for place in places if str(place).startswith(ours))
    traces = {"seconds": sound, "failed": tracer.failed, "lines": tracer.lines(), "loaded": loaded}
    result.write_text(json.dumps(traces), encoding="utf-8")


def traced(root: Path, rooms: tuple[str, ...], context: BaseContext) -> dict[str, Any]:
    """Who runs which line, of every test file; kept until the file or a module that it loads changes."""
    traces = json.loads(TRACES.read_text(encoding="utf-8")) if TRACES.exists() else {}
    folders = {tests_of(root, Path(room)) for room in rooms}
    places = {path for folder in folders for path in folder.rglob("test_*.py")}
    modules = {path.stem for room in rooms for path in root.glob(f"{room.removesuffix('.py')}*/**/*.py")}
    for path in (root / "tests").rglob("test_*.py"):  # those of a module may lie with what asks it
        if path.stem.removeprefix("test_") in modules:
            places.add(path)
    chosen: dict[str, Any] = {}
    for path in sorted(places):
        file = str(path.relative_to(root))
        before = traces.get(file, {"loaded": [], "digest": ""})
        if before["digest"] == _of_run(root, path, before["loaded"]):
            chosen[file] = before
            continue
        begin, result = time.monotonic(), root / "traced.json"
        result.unlink(missing_ok=True)
        process = context.Process(target=_trace, args=(root, file, result))  # type: ignore[attr-defined]
        process.start()
        process.join(HANGS_S)
        if process.is_alive() or not result.exists():
            process.kill()
            process.join()
            now = {
                "seconds": {},
                "failed": ["all of it, since it hangs or crashes"],
                "lines": {},
                "loaded": [],
            }
        else:
            now = json.loads(result.read_text(encoding="utf-8"))
        traces[file] = chosen[file] = now | {"digest": _of_run(root, path, now["loaded"])}
        failed = "".join(f"; fails on sound code, and is not asked: {name}" for name in now["failed"])
        print(f"traced {file} in {time.monotonic() - begin:.0f} s{failed}", flush=True)
        TRACES.parent.mkdir(parents=True, exist_ok=True)
        TRACES.write_text(json.dumps(traces), encoding="utf-8")
    return chosen


def _of_run(root: Path, path: Path, loaded: list[str]) -> str:
    modules = [root / name for name in loaded]
    return digest(root, *of_tests(root, path), *(module for module in modules if module.exists()))


def of_tests(root: Path, path: Path) -> list[Path]:
    """A file of tests, and the modules beside the tests that it names."""
    text = path.read_text(encoding="utf-8")
    return [path, *(each for each in sorted((root / "tests").glob("*.py")) if each.stem in text)]


def tests_of(root: Path, room: Path) -> Path:
    """The folder of tests of a room, or of the nearest room around it that has tests."""
    folder = root / "tests" / room.relative_to("upplied").with_suffix("")
    while not any(folder.glob("test_*.py")) and folder != root / "tests" / room.parts[1]:
        folder = folder.parent
    return folder


def digest(root: Path, *paths: Path) -> str:
    whole = hashlib.sha256()
    for path in paths:
        whole.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()


def tests_for(mutant: Mutant, files: dict[str, Any], root: Path) -> list[tuple[str, float]]:
    """The tests that run a mutant's lines, and their seconds: of its module first, then of its room."""
    room = f"{tests_of(root, mutant.path.parent).relative_to(root)}/"
    module = f"{room}test_{mutant.path.stem}.py"
    tests: dict[str, float] = {}
    loading: set[str] = set()  # asked last: they load the module, and run none of its lines in sight
    for file, of in files.items():
        run, seconds = of["lines"].get(str(mutant.path), {}), of["seconds"]
        who = set()
        for line, names in run.items():
            if not mutant.traced or int(line) in mutant.lines:
                who.update(names)
        tests |= seconds if file in who else {name: seconds[name] for name in who & seconds.keys()}
        if not mutant.traced and str(mutant.path) in of["loaded"]:
            loading |= seconds.keys() - tests.keys()
            tests |= seconds

    def order(each: tuple[str, float]) -> tuple[bool, bool, bool, float]:
        name, lasts = each
        return name in loading, not name.startswith(module), not name.startswith(room), lasts

    return sorted(tests.items(), key=order)
