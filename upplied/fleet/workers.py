"""Processes that outlive what runs in them: a hang, a native crash or a full memory costs one job.

Every worker is an executor of a single process. When that process dies, the job it held is the
culprit, nobody else's, and the process is replaced; a job past its time is stopped by killing its
process, since native code does not listen to anything gentler.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, connection, get_context, parent_process
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import Any, TypeVar

from upplied.errors import UppliedError

Value = TypeVar("Value")

# Every worker computes on one core: libraries that start a thread per core would only compete.
ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "ARROW_CPU_THREADS",
        "POLARS_MAX_THREADS",
        "UPPLIED_THREADS",
    ),
    "1",
)
START_UP_S = 180.0  # a fresh process imports its libraries in 2 s; a loaded machine may need far longer

_environment = threading.Lock()


class JobKilled(Exception):
    """The job ended with its process; the text says how."""


class WorkersClosed(Exception):
    """The workers were closed while the job ran; nothing is known about the job."""


class WorkersBroken(UppliedError):
    """Not even an empty worker runs on this machine: the run ends, and no target is blamed."""


@dataclass(frozen=True)
class Limits:
    """What one job may use before its process is stopped."""

    timeout_s: float = 600.0
    memory_gib: float | None = None  # address space of a worker; None: the machine's memory / workers

    def memory_bytes(self, workers: int) -> int:
        """The address space each of `workers` processes may use, bytes."""
        if self.memory_gib is not None:
            return int(self.memory_gib * 2**30)
        machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        return max(machine // workers, 4 * 2**30)  # the libraries alone map 2 to 3 GiB


class Workers:
    """A fixed number of processes, each prepared by `setup`; `run` may be called from any thread.

    Parameters
    ----------
    count : int
        How many processes compute at the same time.
    setup : callable
        Called once in each fresh process with `setup_args`; must be importable.
    limits : Limits
        Time and memory of one job.

    Examples
    --------
    >>> with Workers(1) as workers:
    ...     workers.run(abs, -2)
    2
    """

    def __init__(
        self,
        count: int,
        setup: Callable[..., None] | None = None,
        setup_args: tuple[Any, ...] = (),
        limits: Limits | None = None,
    ) -> None:
        self.count = count
        self.limits = limits or Limits()
        arguments = (self.limits.memory_bytes(count), setup, setup_args)
        self._closed = False
        self._all = [_Worker(arguments) for _ in range(count)]
        self._free: queue.LifoQueue[_Worker] = queue.LifoQueue()
        for worker in self._all:
            self._free.put(worker)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, function: Callable[..., Value], *args: Any) -> Value:
        """Call ``function(*args)`` in a free worker and wait for its value.

        Raises
        ------
        JobKilled
            If the process died, ran out of memory or had to be stopped after the time limit.
        WorkersBroken
            If no process could be started.
        WorkersClosed
            If `close` was called before the job was done.
        """
        worker = self._free.get()
        try:
            if self._closed:
                raise WorkersClosed
            return worker.run(function, args, self.limits)
        except JobKilled:
            if self._closed:
                raise WorkersClosed from None
            raise
        finally:
            self._free.put(worker)

    def close(self) -> None:
        """Stop the processes; jobs that still run are lost."""
        self._closed = True
        for worker in self._all:
            worker.close()


class _Worker:
    """One process, started when first needed and again after it was lost."""

    def __init__(self, arguments: tuple[Any, ...]) -> None:
        # The number of the job that the process has begun, which it writes and this one reads.
        self._begun = get_context("spawn").RawValue("Q", 0)
        self._number, self._closed = 0, False
        self._arguments = (*arguments, self._begun)
        self._executor: ProcessPoolExecutor | None = None
        self._process: BaseProcess | None = None

    def run(self, function: Callable[..., Value], args: tuple[Any, ...], limits: Limits) -> Value:
        try:
            return self._run(function, args, limits)
        except BrokenProcessPool:
            begun, reason = self._begun.value == self._number, self._obituary()
            self.stop()
            if begun or self._closed:
                raise JobKilled(reason) from None
        try:  # the process died before it began this job, which is not the culprit
            return self._run(function, args, limits)
        except BrokenProcessPool:
            reason = self._obituary()
            self.stop()
            raise JobKilled(reason) from None

    def _run(self, function: Callable[..., Value], args: tuple[Any, ...], limits: Limits) -> Value:
        executor = self._executor or self._start()
        self._number += 1
        try:
            future = executor.submit(_begin, self._number, function, args)
            if not wait([future], limits.timeout_s).done:
                self.stop()
                raise JobKilled(f"took longer than {limits.timeout_s:g} s and was stopped")
            value: Value = future.result()
            return value
        except MemoryError:
            self.stop()  # what is left of its heap is nobody's guess
            raise JobKilled(f"needed more memory than the {_gib(self._arguments[0])} of a worker") from None

    def _start(self, attempts: int = 2) -> ProcessPoolExecutor:
        executor = ProcessPoolExecutor(1, get_context("spawn"), _prepare, self._arguments)
        try:
            with _bare_child():  # while it is made; it loads what it needs beside the others
                started = executor.submit(os.getpid)
            pid = started.result(START_UP_S)
        except (BrokenProcessPool, TimeoutError):
            executor.shutdown(wait=False, cancel_futures=True)
            if attempts > 1:
                return self._start(attempts - 1)
            raise WorkersBroken(
                "worker processes", "do not start", remedy="see what `upplied doctor` says"
            ) from None
        self._process = next((child for child in active_children() if child.pid == pid), None)
        self._executor = executor
        return executor

    def _obituary(self) -> str:
        code = _exit_code(self._process)
        if code is not None and code < 0:
            return f"its process was ended by {signal.Signals(-code).name}"
        return "its process ended" + ("" if code is None else f" with exit code {code}")

    def close(self) -> None:
        self._closed = True
        self.stop()

    def stop(self) -> None:
        process, self._process = self._process, None
        executor, self._executor = self._executor, None
        if process is not None and process.is_alive():
            process.kill()
        if executor is not None:
            executor.shutdown(wait=True, cancel_futures=True)


def _exit_code(process: BaseProcess | None, patience_s: float = 5.0) -> int | None:
    """The exit code of a process that has died; the executor's own thread may be about to note it."""
    deadline = time.monotonic() + patience_s
    while process is not None and time.monotonic() < deadline:
        if process.exitcode is not None:
            return process.exitcode
        time.sleep(0.01)
    return None


def _gib(size: int) -> str:
    return f"{size / 2**30:g} GiB"


@contextmanager
def _bare_child() -> Iterator[None]:
    """What a child that is started within inherits: one thread a library, and not the caller's script.

    Libraries read the environment while they load. A spawned process would run the main script again,
    which then must hide its work behind ``if __name__ == "__main__"``; our jobs need nothing of it.
    """
    with _environment:
        before = {name: os.environ.get(name) for name in ONE_THREAD}
        script = sys.modules["__main__"]
        os.environ.update(ONE_THREAD)
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


_job_begun: Any = None  # in a worker: where the number of the job that it has begun stands


def _begin(number: int, function: Callable[..., Value], args: tuple[Any, ...]) -> Value:
    """Do a job in a worker, and say first that it has begun: from then on a death is its own."""
    _job_begun.value = number
    return function(*args)


def _prepare(
    memory_bytes: int, setup: Callable[..., None] | None, setup_args: tuple[Any, ...], begun: Any
) -> None:
    """First thing in a fresh process: die with the parent, stay within memory, load what jobs need."""
    global _job_begun
    _job_begun = begun
    threading.Thread(target=_die_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    _limit_memory(memory_bytes)
    if setup is not None:
        setup(*setup_args)


def _die_with_parent() -> None:
    """A killed parent says no farewell; its children must not compute on, nor hold its files."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _limit_memory(size: int) -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (size if hard < 0 else min(size, hard), hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
