"""The published reports over HTTP: from a page of Prefect's no browser follows a link to a file."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from flows.environment import ROOT

FOLDER = ROOT / "reports"
ADDRESS = "UPPLIED_REPORTS_URL"  # of that folder, where a server gives it out


class _Pages(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Nobody reads who looked at what."""


@contextmanager
def served(folder: Path, port: int) -> Iterator[str]:
    """Give a folder out on 127.0.0.1 as long as the block lasts, on another port where this one is taken."""
    handler = partial(_Pages, directory=str(folder))
    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), handler)
    except OSError:
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    with server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()


def address(reports: str, page: str) -> str:
    """Where a page of a folder of reports opens: over HTTP where that folder is given out, else as a file."""
    folder = Path(reports).absolute()
    url = os.environ.get(ADDRESS)
    return f"{url.rstrip('/')}/{page}" if url and folder == FOLDER else (folder / page).as_uri()
