"""What the source says of the fields of a class, in the comments before and beside them."""

from __future__ import annotations

import inspect
import re


def comments(kind: type) -> dict[str, str]:
    """What the comments before and beside the fields of a class say of each."""
    comments: dict[str, str] = {}
    before: list[str] = []
    for line in inspect.getsource(kind).splitlines():
        text, _, comment = line.strip().partition("# ")
        if name := re.match(r"(\w+): ", text):
            comments[name[1]] = " ".join([*before, comment]).strip()
        before = [*before, comment] if comment and not text else []
    return {
        name: f"{comment[:1].upper()}{comment[1:].rstrip('.')}."
        for name, comment in comments.items()
        if comment
    }
