"""Trees of nodes with transforms, flattened; what refers to itself or explodes is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from upplied.inputs.formats.raw import Source
from upplied.records import Floats

Node = TypeVar("Node")
_MAX_DEPTH = 256


def flatten(
    source: Source,
    roots: list[tuple[Node, Floats]],
    children: Callable[[Node], list[tuple[Node, Floats]]],
) -> Iterator[tuple[Node, Floats]]:
    """Every node with its transform (4, 4) to the scene, depth first, in order.

    Parameters
    ----------
    roots : list of (node, matrix)
    children : callable
        The children of a node, each with its transform to that node.
    """
    most = max(10_000, len(source.data) // 10)  # nodes, each placed as often as it is named
    stack = [(node, matrix, 0) for node, matrix in reversed(roots)]
    for _ in range(most + 1):
        if not stack:
            return
        node, matrix, depth = stack.pop()
        if depth > _MAX_DEPTH:
            break
        if not np.isfinite(matrix).all():
            raise source.error("a node's transform is not finite", "finite numbers")
        yield node, matrix
        stack.extend((child, matrix @ local, depth + 1) for child, local in reversed(children(node)))
    raise source.error(
        "its scene refers to itself or has too many nodes",
        f"at most {most} nodes, {_MAX_DEPTH} deep",
        "export it flattened",
    )
