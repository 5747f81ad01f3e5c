"""Continuous Frechet distance: ours against the published library that computes the same value.

    python bench/frechet.py [--large]

Both are compiled before the clock starts. The peer is curvesimilarities (numba as well); it is wrong
where a curve has only two vertices, so the curves here have more. --large adds curves of 1000
vertices, for which the peer takes half a minute, and longer ones for ours alone.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from curvesimilarities.frechet import fd

from upplied.planning.geometry.frechet import frechet
from upplied.records import Floats


def main() -> None:
    """Print one line per size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--large", action="store_true", help="1000 vertices and more")
    options = parser.parse_args()
    small = helices(20)
    frechet(*small), fd(*small)
    print(f"{'vertices':>10}{'ours, CPU ms':>15}{'peer, CPU ms':>15}{'ratio':>9}{'difference':>13}")
    for number in (100, 300, 1000) if options.large else (100, 300):
        curves = helices(number)
        ours, value = clocked(frechet, curves, 9)
        peer, other = clocked(fd, curves, 1)
        print(f"{number:10d}{ours:15.2f}{peer:15.0f}{peer / ours:9.0f}{abs(value - other):13.1e}", flush=True)
    for number in (1000, 3000, 10_000) if options.large else (1000,):
        ours, _ = clocked(frechet, helices(number), 3)
        print(f"{number:10d}{ours:15.2f}{'-':>15}{'-':>9}{'-':>13}", flush=True)


def helices(number: int) -> tuple[Floats, Floats]:
    """A smooth path and a noisy one with other vertices, as a plan and its demonstration are."""
    rng = np.random.default_rng(number)
    planned, flown = np.linspace(0, 1, number), np.linspace(0, 1, int(0.93 * number))
    return (
        np.column_stack([11 * np.cos(20 * planned), 11 * np.sin(20 * planned), 31 * planned]),
        np.column_stack([10 * np.cos(20 * flown), 10 * np.sin(20 * flown), 30 * flown])
        + rng.normal(0, 0.1, (len(flown), 3)),
    )


def clocked(
    function: Callable[[Floats, Floats], float], curves: tuple[Floats, Floats], times: int
) -> tuple[float, float]:
    """Best CPU time, ms, and the value."""
    spent, value = np.inf, np.nan
    for _ in range(times):
        began = time.process_time()
        value = float(function(*curves))
        spent = min(spent, 1e3 * (time.process_time() - began))
    return spent, value


if __name__ == "__main__":
    main()
