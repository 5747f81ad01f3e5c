"""Where a catalog and its cache lie."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote, urlsplit

from upplied.errors import CatalogError


def checked(location: str) -> str:
    """An absolute folder, or a URI that carries no credential."""
    if location.startswith("file://"):
        parts = urlsplit(location)
        if parts.netloc not in ("", "localhost") or not parts.path:
            raise CatalogError(location, "is no file of this machine", "file:///folder")
        return str(Path(unquote(parts.path)))
    if "://" not in location:
        return str(Path(location).expanduser().absolute())
    scheme, _, rest = location.partition("://")
    if "@" in rest or "?" in rest:
        raise CatalogError(
            f"location {scheme}://...",
            "has a user, a password or options in it",
            f"{scheme}://bucket/prefix",
            "put credentials into the environment (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, ...)",
        )
    if not rest.strip("/"):
        raise CatalogError(f"location {location}", "names no bucket", f"{scheme}://bucket/prefix")
    return location.rstrip("/")


def cache_folder(location: str) -> Path:
    """Beside the tables of a folder; for an object store in the user's cache directory."""
    if "://" not in location:
        return Path(location) / "cache"
    home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return home / "upplied" / "".join(c if c.isalnum() else "-" for c in location)
