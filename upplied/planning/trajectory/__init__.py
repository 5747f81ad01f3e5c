"""The carried flight made a trajectory: completed, safe, timed."""
