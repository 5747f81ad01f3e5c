"""The flight carried from the source to the target."""
