"""Orchestration: Prefect tasks of one call and flows of one page, installed as `upplied.flows`."""
