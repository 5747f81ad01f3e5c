"""What on the target answers to what on the source: registration, parts, displacement field."""
