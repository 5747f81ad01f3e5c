"""Curves, poses, and the scenes that rays are cast in: meshes, clouds and what was never scanned."""
