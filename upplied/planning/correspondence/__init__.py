"""What on the target corresponds to what on the source: registration, parts, displacement field."""
