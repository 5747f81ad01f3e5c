"""What is kept: structures, demonstrations and plans, in tables that many may fill at once."""

from upplied.catalog.cache import Cache
from upplied.catalog.database import Catalog, open_catalog
from upplied.catalog.published import export_tables
from upplied.catalog.queries import PlannedTrajectory

__all__ = ["Cache", "Catalog", "PlannedTrajectory", "export_tables", "open_catalog"]
