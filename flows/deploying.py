"""Work pools, deployments and automations onto the environment's server, by ``python -m``."""

from __future__ import annotations

import sys

from prefect import get_client
from prefect.cli import app
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.workers.process import ProcessWorker

from .automations import apply, zombies

POOLS = ("local", "planners")  # of the runs themselves; of their shards, where several machines plan


def deploy(declarations: str) -> None:
    """Make the pools and every deployment of a file, and mark silent runs crashed from now on."""
    template = ProcessWorker.get_default_base_job_template()
    with get_client(sync_client=True) as client:
        for name in POOLS:
            pool = WorkPoolCreate(name=name, type=ProcessWorker.type, base_job_template=template)
            client.create_work_pool(pool, overwrite=True)
    apply(zombies())
    sys.argv = ["prefect", "--no-prompt", "deploy", "--all", "--prefect-file", declarations]
    app()


if __name__ == "__main__":
    deploy(sys.argv[1])
