"""Mesh and point cloud files, one module per format: bytes in, a `RawMesh` out, nothing else opened."""
