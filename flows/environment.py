"""What Prefect is told through its environment, in one place; `.env.example` says the same."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).parents[1]

SETTINGS = {
    # Nothing is reported to anybody.
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "RAY_USAGE_STATS_ENABLED": "0",
    # A deployment's concurrency slot must survive a power cut: leases in the server's memory die with
    # it, and the nightly run would then be cancelled for ever.
    "PREFECT_SERVER_CONCURRENCY_LEASE_STORAGE": "prefect.server.concurrency.lease_storage.filesystem",
    # Without a server Prefect would start one per process and lose most of the history; say so instead.
    "PREFECT_SERVER_ALLOW_EPHEMERAL_MODE": "false",
    # A run waits two minutes for a server that is away (2 + 4 + ... + 64 s), rather than one.
    "PREFECT_CLIENT_MAX_RETRIES": "6",
    # A worker asks for work this often, s: at Prefect's 10 the start of a short run is mostly waiting.
    "PREFECT_WORKER_QUERY_SECONDS": "3",
    # A killed run is told from a healthy one by its heartbeats (see prefect.yaml).
    "PREFECT_FLOWS_HEARTBEAT_FREQUENCY": "30",
    # Prefect's own history is kept for a month; the catalog keeps what matters for good.
    "PREFECT_SERVER_SERVICES_DB_VACUUM_ENABLED": "events,flow_runs",
    "PREFECT_SERVER_SERVICES_DB_VACUUM_RETENTION_PERIOD": "2592000",
    "PREFECT_LOGGING_EXTRA_LOGGERS": "upplied",
    "PREFECT_CLI_PROMPT": "false",
}


def environment(home: Path, api_url: str) -> dict[str, str]:
    """This process's environment for Prefect processes of ours.

    Parameters
    ----------
    home : path
        Folder of Prefect's own database and settings.
    api_url : str
        Address of the server, e.g. ``http://127.0.0.1:4200/api``.
    """
    foreign = {name for name in os.environ if name.startswith("PREFECT_")}
    kept = {name: value for name, value in os.environ.items() if name not in foreign}
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return (
        kept
        | SETTINGS
        | {
            "PREFECT_HOME": str(home),
            "PREFECT_API_URL": api_url,
            "PYTHONPATH": os.pathsep.join(paths),
            "UPPLIED_HOME": str(ROOT),
        }
    )
