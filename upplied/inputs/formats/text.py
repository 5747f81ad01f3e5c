"""Numbers in text files."""

from __future__ import annotations

import warnings

import numpy as np

from upplied.records import Floats, Ints


def numbers(text: bytes) -> Floats:
    """All numbers of a text that white space separates.

    Raises ValueError where something else stands among them.

    Examples
    --------
    >>> numbers(b"1 2.5\\n-3e1")
    array([  1. ,   2.5, -30. ])
    """
    text = text.strip()
    if not text:
        return np.empty(0)
    if b"\0" in text or b"," in text:
        raise ValueError("not a number")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older numpy warns where newer raises
        try:
            return np.fromstring(text, sep=" ")
        except DeprecationWarning as error:
            raise ValueError(str(error)) from None


def integers(text: bytes) -> Ints:
    """All whole numbers of a text that white space separates."""
    return whole(numbers(text))


def whole(values: Floats) -> Ints:
    """Numbers that must be whole as integers."""
    if not (np.abs(values) < 2**53).all() or (values != np.rint(values)).any():
        raise ValueError("not a whole number")
    return values.astype(np.int64)


def widths(text: bytes) -> Ints:
    """How many words stand on each line; every line ends with a line feed.

    Examples
    --------
    >>> widths(b"1 2\\n\\n3\\n")
    array([2, 0, 1])
    """
    characters = np.frombuffer(text, np.uint8)
    inside = characters > ord(" ")
    begins = inside.copy()
    begins[1:] &= ~inside[:-1]
    ends = np.flatnonzero(characters == ord("\n"))
    return np.diff(np.searchsorted(np.flatnonzero(begins), ends), prepend=0)
