"""The published reports over HTTP: from a page of Prefect's no browser follows a link to a file."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import IO

from upplied import guard

from .api import allowed_hosts
from .environment import home

ADDRESS = "UPPLIED_REPORTS_URL"  # of the folder of reports, where a server gives it out
HEADERS = guard.HEADERS | {
    "Referrer-Policy": "no-referrer",
    # The pages hold their own styles and scripts; nothing else is loaded, and nothing is sent anywhere.
    "Content-Security-Policy": "default-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "  # the plotting library compiles code
    "frame-ancestors 'none'; form-action 'none'; base-uri 'none'; object-src 'none'",
}


class _Pages(SimpleHTTPRequestHandler):
    """Files of one folder: no listing, nothing that lies elsewhere, nobody who asks by another name."""

    def send_head(self) -> IO[bytes] | None:  # type: ignore[override]
        path = Path(self.translate_path(self.path))
        if guard.host_name(self.headers.get("Host", "")) not in allowed_hosts():
            self.send_error(HTTPStatus.FORBIDDEN, "This server does not answer to that name")
            return None
        if not _inside(path, Path(self.directory)) or (path.is_dir() and not (path / "index.html").is_file()):
            self.send_error(HTTPStatus.NOT_FOUND)
            return None
        return super().send_head()

    def list_directory(self, path: object) -> None:
        """No folder is listed."""
        self.send_error(HTTPStatus.NOT_FOUND)

    def end_headers(self) -> None:
        for name, value in HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Nobody reads who looked at what."""


def _inside(path: Path, folder: Path) -> bool:
    """Whether a path lies in a folder by its own name, and not by that of a link."""
    real = folder.resolve()
    index = path / "index.html" if path.is_dir() else path
    try:
        return index.resolve() == real / index.relative_to(folder)
    except ValueError:
        return False


@contextmanager
def served(folder: Path, port: int, host: str = "127.0.0.1") -> Iterator[str]:
    """Give a folder out as long as the block lasts, on another port where this one is taken."""
    handler = partial(_Pages, directory=str(folder))
    try:
        server = ThreadingHTTPServer((host, port), handler)
    except OSError:
        server = ThreadingHTTPServer((host, 0), handler)
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
    given_out = folder == home() / "reports"
    return f"{url.rstrip('/')}/{page}" if url and given_out else (folder / page).as_uri()
