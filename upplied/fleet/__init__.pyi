from upplied.fleet.admission import RuleOptions as RuleOptions
from upplied.fleet.admission import check_structures as check_structures
from upplied.fleet.decisions import Decision as Decision
from upplied.fleet.decisions import Job as Job
from upplied.fleet.decisions import PlanRequest as PlanRequest
from upplied.fleet.decisions import decide as decide
from upplied.fleet.flights import Rechecked as Rechecked
from upplied.fleet.flights import recheck as recheck
from upplied.fleet.ingest import ingest_demonstrations as ingest_demonstrations
from upplied.fleet.ingest import ingest_structures as ingest_structures
from upplied.fleet.planner import Shard as Shard
from upplied.fleet.reading import Ingested as Ingested
from upplied.fleet.run import Resources as Resources
from upplied.fleet.run import Result as Result
from upplied.fleet.run import Run as Run
from upplied.fleet.run import cores as cores
from upplied.fleet.run import known_outcomes as known_outcomes
from upplied.fleet.run import plan_here as plan_here
from upplied.fleet.run import shard_name as shard_name
from upplied.fleet.run import shards as shards
from upplied.fleet.run import transfer as transfer
from upplied.fleet.workers import Limits as Limits
from upplied.outputs.publish import publish as publish

def new_run_id() -> str: ...
