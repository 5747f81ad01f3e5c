"""Plan the inspection of every structure of a kind from one expert's flight."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog, open_catalog

__version__ = "0.1.0"

# Loaded when first asked for, so that `import upplied` and the command's help stay fast.
_PUBLIC = {
    "Catalog": "upplied.catalog.database",
    "open_catalog": "upplied.catalog.database",
}

__all__ = ["Catalog", "__version__", "open_catalog"]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
