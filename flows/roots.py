"""Where a run may read and write: under the folders and object-store URIs that whoever serves declared."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote, urlsplit

from prefect import runtime

from upplied.errors import SettingsError

from .environment import ROOTS, home


def check_roots(**locations: str | Sequence[str]) -> None:
    """Refuse locations, by parameter, outside the roots; where none is declared all may be used."""
    roots = named_roots() or ([str(home())] if runtime.deployment.id else [])  # a deployment has its folder
    for name, given in locations.items():
        for location in filter(None, [given] if isinstance(given, str) else given):
            if roots and not any(_within(location, root) for root in roots):
                fault = "lies outside the roots that runs may use"
                rule = f"one of {', '.join(roots)}, or under it"
                remedy = f"declare it where the fleet is served: upplied serve --root, or {ROOTS}"
                raise SettingsError(f"{name} {location!r}", fault, rule, remedy)


def named_roots() -> list[str]:
    """The roots that the environment declares."""
    return [root.strip() for root in os.environ.get(ROOTS, "").split(",") if root.strip()]


def _within(location: str, root: str) -> bool:
    """Whether a location is a root or under it: links followed, and read as whoever opens it reads it."""
    place, base = _plain(location), _plain(root)
    if ("://" in place) != ("://" in base):
        return False
    if "://" in place:
        parts = unquote(place).split("/")
        return not {"..", "."} & {*parts} and "%" not in place and f"{place}/".startswith(f"{base}/")
    try:
        return Path(place).resolve().is_relative_to(Path(base).resolve())
    except (OSError, ValueError):  # no path at all
        return False


def _plain(location: str) -> str:
    """An address of a store, or a path of this machine."""
    if location.startswith("file://"):
        parts = urlsplit(location)
        return unquote(parts.path) if parts.netloc in ("", "localhost") else location
    return location.rstrip("/") if "://" in location else os.path.expanduser(location)
