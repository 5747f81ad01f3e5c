"""Tracks: timed poses from a log, cleaned, cut to the inspection, and carried to the camera."""
