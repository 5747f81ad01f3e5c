"""Pictures by casting rays, without a display or a GPU."""
