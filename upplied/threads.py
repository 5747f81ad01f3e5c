"""On how many threads this process computes: linear algebra of a plan on one, rays as it was told.

The matrices of a plan are small: more threads wait for each other longer than they compute, and how
they part a sum shows in the last digit of every plan.
"""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from threadpoolctl import threadpool_limits

_LOCK = threading.Lock()
_LIMITS = ExitStack()
_holders = 0
_rays = 0


def cast_rays_on(threads: int) -> None:
    """Say when a process begins on how many threads its scenes cast rays; 0: as the library chooses.

    A worker says 1, or each would take the cores of the others. Results do not depend on it.
    """
    global _rays
    _rays = threads


def ray_threads() -> int:
    """On how many threads new scenes cast rays; 0: as the library chooses."""
    return _rays


@contextmanager
def one_thread() -> Iterator[None]:
    """While this lasts, BLAS computes with one thread; afterwards with as many as before.

    It may be entered again, and from several threads: the last to leave gives the threads back.
    """
    global _holders
    with _LOCK:
        if _holders == 0:
            _LIMITS.enter_context(threadpool_limits(1, user_api="blas"))
        _holders += 1
    try:
        yield
    finally:
        with _LOCK:
            _holders -= 1
            if _holders == 0:
                _LIMITS.close()
