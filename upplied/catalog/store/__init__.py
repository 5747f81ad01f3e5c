"""Where it is kept: Delta tables, whole files, meshes, the cache."""
