"""What workers of a fleet load, for `tests/forked.py`."""

# ruff: noqa: F401
import upplied.findings.campaign
import upplied.fleet.flight_logs
import upplied.fleet.flights
import upplied.fleet.planner
import upplied.fleet.reading
from upplied.geometry.scene import open3d

open3d()
