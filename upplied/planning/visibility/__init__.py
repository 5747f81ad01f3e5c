"""What a camera sees of a surface: frustum, line of sight, resolution and incidence."""
