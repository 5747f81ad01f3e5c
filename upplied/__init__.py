"""Plan the inspection of every structure of a kind from one expert's flight."""

from upplied.extras import public_names

__version__ = "0.2.0"

_PUBLIC, __getattr__ = public_names(__name__, __path__[0])  # of `__init__.pyi`
__all__ = ["__version__", *_PUBLIC]


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
