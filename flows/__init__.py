"""Orchestration: Prefect tasks of one call and flows of one page. Run from a clone; not installed."""
