"""A plan in a browser of this machine: changed and judged at once, released or rejected."""
