"""Prefect's server behind the guard that stands before our own pages too; ``upplied serve`` starts it.

Without it every page that a browser of this machine opens could ask the server to run something.
"""

from __future__ import annotations

from upplied.web.guard import Guard, allowed_names


def create_app() -> Guard:
    """Prefect's application with the guard before it."""
    from prefect.server.api import server

    from . import automations  # noqa: F401  the server sends by our own kind of block, too

    # Around it and not in it: its own services ask the same application, by a name of theirs.
    return Guard(server.create_app(final=True), allowed_names())
