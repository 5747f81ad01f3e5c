"""Worker processes that are forked from one which has loaded all that they need, for tests that start many.

A worker of the program is a fresh process that imports its libraries, which takes 2 s each time. Here it has
imported them: all else (environment, folder, limits, its end with the parent) is as it is there.
"""

from __future__ import annotations

import os
from multiprocessing import context, forkserver
from pathlib import Path
from unittest.mock import patch

from upplied.fleet import workers

AS_IT_IS = workers._Context


class Process(context.ForkServerProcess):
    """As `workers._Process`, with the environment of whoever starts it."""

    def start(self) -> None:
        with workers._bare_child():
            self.environment = dict(os.environ)
            # Of Python's path it knows nothing else.
            with patch.dict(os.environ, {"PYTHONPATH": str(Path(__file__).parent)}):
                forkserver.ensure_running()
            super().start()

    def run(self) -> None:
        os.environ.clear()
        os.environ.update(self.environment)
        super().run()

    def terminate(self) -> None:
        self.kill()


class Context(context.ForkServerContext):
    """Starts the process that they are forked from with the first of them."""

    Process = Process


def prepare() -> None:
    """Say what is loaded before processes are forked; the libraries read the environment as they are."""
    forkserver.set_forkserver_preload(["preloaded"])
