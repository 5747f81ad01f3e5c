"""What is kept: structures, demonstrations and plans, in tables that many may fill at once."""

import os

from upplied.extras import public_names

# Read when pyarrow is loaded: its own allocator holds 40 MB more of a process that writes, and is no faster.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

_PUBLIC, __getattr__ = public_names(__name__, __path__[0])  # of `__init__.pyi`
__all__ = [*_PUBLIC]
