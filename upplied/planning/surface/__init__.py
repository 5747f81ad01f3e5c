"""What a structure looks like from outside: voxel clouds, samples with normals, parts."""
