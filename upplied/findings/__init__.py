"""Findings: where marks in photos lie on structures, which looks show them, and the same places elsewhere."""
