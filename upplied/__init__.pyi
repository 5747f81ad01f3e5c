# The database: what was flown and planned.
from upplied.catalog.database import Catalog as Catalog
from upplied.catalog.database import open_catalog as open_catalog

# Files to records, records to a plan, a plan to a mission; and the base of every error raised on purpose.
from upplied.config import Settings as Settings
from upplied.config import settings_for as settings_for
from upplied.errors import UppliedError as UppliedError
from upplied.inputs.logs import read_demonstration as read_demonstration
from upplied.inputs.manifests import read_manifest as read_manifest
from upplied.inputs.meshes import read_structure as read_structure
from upplied.outputs.missions import MissionOptions as MissionOptions
from upplied.outputs.missions import export as export
from upplied.planning.plan import plan_transfer as plan_transfer

# The nouns.
from upplied.records import Camera as Camera
from upplied.records import Cloud as Cloud
from upplied.records import Correspondences as Correspondences
from upplied.records import Demonstration as Demonstration
from upplied.records import Measures as Measures
from upplied.records import Placement as Placement
from upplied.records import Plan as Plan
from upplied.records import Registration as Registration
from upplied.records import Structure as Structure
from upplied.records import Surroundings as Surroundings
from upplied.records import Trajectory as Trajectory

__version__: str
