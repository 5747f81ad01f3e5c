"""Processes that outlive what runs in them: a hang, a native crash or a full memory costs one job.

One pool of `pebble`'s of a single process to a worker: of several, a killed process may hold the lock of
all. Around it stands what our jobs need: one thread each, an address space of their own size, and an end
with the parent.
"""

import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, TimeoutError
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, context, current_process, parent_process
from types import ModuleType
from typing import Any, TypeVar

from pebble import ProcessExpired, ProcessPool

from upplied.errors import UppliedError
from upplied.threads import cast_rays_on

Value = TypeVar("Value")
Setup = Callable[..., None] | None

# Every worker computes on one core: libraries that start a thread per core would only compete.
_LIBRARIES = ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "NUMBA_NUM", "ARROW_CPU", "POLARS_MAX")
ONE_THREAD = {f"{name}_THREADS": "1" for name in _LIBRARIES}
START_UP_S = 180.0  # a fresh process imports its libraries in 2 s; a loaded machine may need far longer

OUT_OF_MEMORY = 77  # exit code of a process whose job could not be given memory
ATTEMPTS = 3  # processes that may die, one after the other, before a job has begun

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
        if self.memory_gib is not None:
            return int(self.memory_gib * 2**30)
        machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        return max(machine // workers, 4 * 2**30)  # the libraries alone map 2 to 3 GiB


class Workers(AbstractContextManager["Workers"]):
    """A fixed number of processes, each prepared by `setup`; `run` may be called from any thread.

    `setup`, which must be importable, is called once in each fresh process with `setup_args`; the limits
    are those of one job.

    Examples
    --------
    >>> with Workers(1) as workers:
    ...     workers.run(abs, -2)
    2
    """

    def __init__(
        self, count: int, setup: Setup = None, setup_args: tuple[Any, ...] = (), limits: Limits | None = None
    ) -> None:
        self.count = count
        limits = limits or Limits()
        self._all = [_Worker(limits, limits.memory_bytes(count), setup, setup_args) for _ in range(count)]
        self._free: queue.LifoQueue[_Worker] = queue.LifoQueue()
        for worker in self._all:
            self._free.put(worker)

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, function: Callable[..., Value], *args: Any) -> Value:
        """Call ``function(*args)`` in a free worker and wait for its value.

        Raises `JobKilled` if the process died, ran out of memory or had to be stopped after the time limit,
        `WorkersBroken` if none could be started, `WorkersClosed` if `close` was called before.
        """
        worker = self._free.get()
        try:
            return worker.run(function, args)
        finally:
            self._free.put(worker)

    def close(self) -> None:
        """Stop the processes; jobs that still run are lost."""
        for worker in self._all:
            worker.close()


class _Worker:
    """One process, started when first needed and again after it was lost."""

    def __init__(self, limits: Limits, memory_bytes: int, *setup: Any) -> None:
        self._limits, self._memory_bytes = limits, memory_bytes
        self._initial = (memory_bytes, *setup)
        self._closed = False
        self._pool: ProcessPool | None = None
        self._job: Future[Any] | None = None
        self._stopping = threading.Lock()

    def run(self, function: Callable[..., Value], args: tuple[Any, ...]) -> Value:
        for _ in range(ATTEMPTS):
            if self._closed:
                raise WorkersClosed
            try:
                pool = self._pool or self._start()
                self._job = pool.schedule(_guarded, (function, *args), timeout=self._limits.timeout_s)
            except (BrokenProcessPool, ProcessExpired, TimeoutError, RuntimeError):
                self._stop()  # it died while it had nothing to do
                continue
            try:
                return self._job.result()
            except BrokenProcessPool:
                self._stop()  # it died before it began this job, which is not the culprit
            except ProcessExpired as death:
                self._stop()
                raise WorkersClosed if self._closed else JobKilled(self._obituary(death.exitcode)) from None
            except TimeoutError as late:
                if late.args[:1] != ("Task timeout",):
                    raise  # of the job's own
                self._stop()
                raise JobKilled(f"took longer than {self._limits.timeout_s:g} s and was stopped") from None
        raise WorkersBroken("worker processes", "do not start", remedy="see what `upplied doctor` says")

    def _start(self) -> ProcessPool:
        pool = ProcessPool(1, initializer=_prepare, initargs=self._initial, context=_Context())
        self._pool = pool
        pool.schedule(os.getpid).result(START_UP_S)  # a start that fails or hangs is no job's
        return pool

    def _obituary(self, code: int) -> str:
        if code == OUT_OF_MEMORY:
            return f"needed more memory than the {self._memory_bytes / 2**30:g} GiB of a worker"
        if code < 0:
            return f"its process was ended by {signal.Signals(-code).name}"
        return f"its process ended with exit code {code}"

    def close(self) -> None:
        self._closed = True
        self._stop()
        job = self._job
        if job is not None and not job.done():
            with suppress(Exception):  # done meanwhile
                job.set_exception(WorkersClosed())

    def _stop(self) -> None:
        with self._stopping:
            pool, self._pool = self._pool, None
            if pool is not None:
                pool.stop()
                pool.join()


class _Process(context.SpawnProcess):
    """A process that inherits one thread a library, and not the caller's script."""

    def start(self) -> None:
        with _bare_child():
            super().start()

    def terminate(self) -> None:
        """At once: native code does not listen to anything gentler."""
        self.kill()


class _Context(context.SpawnContext):
    Process = _Process


@contextmanager
def _bare_child() -> Iterator[None]:
    """What a child that is started within inherits: one thread a library, and not the caller's script."""
    # Libraries read the environment while they load. A worker of Dask is a daemon, which multiprocessing
    # forbids children; ours end with their parent by themselves.
    with _environment:
        before = {name: os.environ.pop(name, None) for name in ONE_THREAD}
        script, here = sys.modules["__main__"], current_process()
        daemon = here._config.get("daemon")  # type: ignore[attr-defined]
        os.environ.update(ONE_THREAD)
        sys.modules["__main__"] = ModuleType("__main__")
        here._config["daemon"] = False  # type: ignore[attr-defined]
        try:
            yield
        finally:
            here._config["daemon"] = daemon  # type: ignore[attr-defined]
            sys.modules["__main__"] = script
            for name in ONE_THREAD:
                del os.environ[name]
            os.environ.update({name: value for name, value in before.items() if value is not None})


def _guarded(function: Callable[..., Value], *args: Any) -> Value:
    """Do a job in the worker; without memory nobody knows what is left of the heap: the process goes too."""
    try:
        return function(*args)
    except MemoryError:
        os._exit(OUT_OF_MEMORY)


def _prepare(memory_bytes: int, setup: Setup, setup_args: tuple[Any, ...]) -> None:
    """First thing in a fresh process: die with the parent, stay within memory, load what jobs need."""
    threading.Thread(target=_die_with_parent, daemon=True).start()
    with suppress(ImportError):  # Windows has none
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        size = memory_bytes if hard < 0 else min(memory_bytes, hard)
        resource.setrlimit(resource.RLIMIT_AS, (size, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    cast_rays_on(1)
    if setup is not None:
        setup(*setup_args)


def _die_with_parent() -> None:
    """A killed parent says no farewell; its children must not compute on, nor hold its files."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
