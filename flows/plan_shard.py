"""A part of a fleet, planned on whichever machine took it from the work pool."""

from __future__ import annotations

from prefect import flow
from prefect.states import Completed, State

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.fleet import manifest

from . import states
from .engines import here
from .parameters import Location, Resources
from .roots import check_roots
from .tasks import worker_of

ALL_CORES = Resources()


@flow(name="plan-shard")
@states.errors_in_words
def plan_shard(catalog: Location, run_id: str, shard: str, resources: Resources = ALL_CORES) -> State:
    """Plan those pairs of a shard that the catalog has no plan for yet.

    The catalog says what is missing: a shard that is started twice is planned once.

    Args:
        catalog: Folder or object-store URI that all machines reach.
        run_id: Of the run over the fleet, kept with every plan.
        shard: Name of the shard, which lies beside the catalog's tables.
        resources: Processes, time and memory on this machine.
    """
    check_roots(catalog=catalog)
    jobs, worker = manifest.read_shard(catalog, shard), worker_of("pool")
    _, missing = fleet.known_outcomes(open_catalog(catalog), jobs, run_id)
    with manifest.attempt(catalog, shard, worker):
        result = here(catalog, missing, resources, run_id, worker)
    return Completed(message=str(result))
