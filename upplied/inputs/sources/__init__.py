"""What people own of a flight, one reader per kind of file: each fills tables and knows nothing else."""
