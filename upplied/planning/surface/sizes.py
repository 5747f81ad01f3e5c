"""Whether two structures are of like size, or the unit of one was mistaken."""

from __future__ import annotations

from upplied.config import Settings
from upplied.records import Structure


def size_ratio(source: Structure, target: Structure) -> float:
    """How many times as large the larger of two structures is, by the diagonals of their boxes."""
    sizes = (source.diagonal_m, target.diagonal_m)
    return float(max(sizes) / max(min(sizes), 1e-9))


def wrong_size(source: Structure, target: Structure, settings: Settings) -> tuple[str, ...]:
    """Why two structures differ too much in size for one to be inspected like the other, in words."""
    return _size_beyond(source, target, settings.verdict.most_size_ratio, "verdict.most_size_ratio")


def odd_size(source: Structure, target: Structure, settings: Settings) -> tuple[str, ...]:
    """The same, where that is odd but may be."""
    return _size_beyond(source, target, settings.verdict.odd_size_ratio, "verdict.odd_size_ratio")


def _size_beyond(source: Structure, target: Structure, most: float, setting: str) -> tuple[str, ...]:
    ratio = size_ratio(source, target)
    if ratio <= most:
        return ()
    sizes = f"the target is {target.diagonal_m:.3g} m across, the source {source.diagonal_m:.3g} m"
    return (f"{sizes}: {ratio:.1f} times, more than {most:g} ({setting}); check their units",)
