"""A part of a fleet, planned on whichever machine took it from the work pool."""

from __future__ import annotations

from prefect import flow
from prefect.states import Completed, State

from flows.engines import here
from flows.parameters import Changes, Id, Location, Presets, Resources, wish_of
from upplied import fleet
from upplied.catalog import open_catalog

NO_CHANGES, ALL_CORES = Changes(), Resources()


@flow(name="plan-shard")
def plan_shard(
    catalog: Location,
    run_id: str,
    keys: list[Id],
    demonstrations: list[Id] | None = None,
    targets: list[Id] | None = None,
    presets: Presets = ("recommended", "baseline"),
    changes: Changes = NO_CHANGES,
    retry_failed: bool = False,
    resources: Resources = ALL_CORES,
) -> State:
    """Plan those of the named pairs that the catalog has no plan for yet.

    The catalog says what is missing, here as in the run that cut the fleet into shards: a shard that
    is started twice is planned once.

    Args:
        catalog: Folder or object-store URI that all machines reach.
        run_id: Of the run over the fleet, kept with every plan.
        keys: Of the plans of this shard.
        demonstrations: As the run over the fleet was asked.
        targets: As the run over the fleet was asked.
        presets: As the run over the fleet was asked.
        changes: As the run over the fleet was asked.
        retry_failed: Also plan again what failed before.
        resources: Processes, time and memory on this machine.
    """
    wish = wish_of(presets, changes, demonstrations, targets, retry_failed)
    wanted = set(keys)
    jobs = [job for job in fleet.decide(open_catalog(catalog), wish).jobs if job.key in wanted]
    return Completed(message=str(here(catalog, jobs, resources, run_id)))
