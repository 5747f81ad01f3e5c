"""Checks of what comes in: what was given, the rule, what is allowed."""

import re
from collections.abc import Iterable
from difflib import get_close_matches

import numpy as np

from upplied.errors import InputError
from upplied.records import Floats

_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def check_id(value: object, what: str) -> str:
    """An identifier that is safe as a file name, in a URL and in HTML.

    Examples
    --------
    >>> check_id("a320-v1", "structure id")
    'a320-v1'
    """
    if isinstance(value, str) and _ID.fullmatch(value):
        return value
    rule = "1 to 64 of A-Z a-z 0-9 _ and -, starting with a letter or digit"
    raise InputError(what, f"got {str(value)[:80]!r}", rule, "choose another id")


def pair_name(demonstration_id: str, target_id: str) -> str:
    """One name for a demonstration and a target, safe as a file name and in a URL; no two pairs share it.

    Examples
    --------
    >>> pair_name("cube-sides-v1", "cuboid-v1")
    'cube-sides-v1--cuboid-v1'
    >>> pair_name("a--b", "c"), pair_name("a", "b--c")  # what no id holds keeps these apart
    ('a--b.c', 'a.b--c')
    """
    joint = "." if "--" in f"{demonstration_id}/{target_id}" or demonstration_id.endswith("-") else "--"
    return f"{demonstration_id}{joint}{target_id}"


def suggested(name: str, known: Iterable[str], most: int = 10) -> str:
    """What of the known names somebody may have meant, for an error: the nearest, or some of them."""
    names = sorted(known)
    near = get_close_matches(name, names, n=3, cutoff=0.6)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"known: {some(names, most) or 'none'}" if most else ""


def some(names: Iterable[object], most: int = 5) -> str:
    """The first of some names, each once, and how many more there are.

    Examples
    --------
    >>> some(["a", "b", "a", "c"], most=2)
    'a, b and 1 more'
    """
    listed = [str(name) for name in dict.fromkeys(names)]
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(listed[:most]) + more


def check_finite(values: Floats, shape: tuple[int | None, ...], what: str) -> Floats:
    """An array of finite floats of the given shape (None: any length)."""
    array = np.asarray(values, float)
    expected = tuple("n" if size is None else size for size in shape)
    sizes = zip(shape, array.shape, strict=False)
    if array.ndim != len(shape) or any(size not in (None, side) for size, side in sizes):
        raise InputError(what, f"has shape {array.shape}", f"shape {expected}")
    bad = int((~np.isfinite(array)).sum())
    if bad:
        raise InputError(what, f"{bad} of {array.size} numbers are not finite", "finite numbers")
    return array
