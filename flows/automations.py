"""What Prefect does by itself: it tells somebody how runs end, and marks silent runs crashed.

By ``python -m`` with the file of the deployments: these and work pools onto the environment's server.
"""

from __future__ import annotations

import sys
from datetime import timedelta
from urllib.parse import urlsplit

from prefect import get_client
from prefect.automations import (
    Automation,
    AutomationCore,
    ChangeFlowRunState,
    EventTrigger,
    Posture,
    SendNotification,
)
from prefect.blocks import notifications as blocks
from prefect.blocks.abstract import NotificationBlock
from prefect.cli import app
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.client.schemas.objects import StateType
from prefect.workers.process import ProcessWorker
from pydantic import Field, SecretStr

from upplied.errors import SettingsError

from .environment import SETTINGS
from .states import TROUBLED

HEARTBEAT_S = int(SETTINGS["PREFECT_FLOWS_HEARTBEAT_FREQUENCY"])
# Ten beats: a loaded server that answers late, or drops some events, must not kill a healthy run.
SILENCE_S = 10 * HEARTBEAT_S
# Events of a run.
TROUBLE = ("Failed", "Crashed", "TimedOut", TROUBLED)
ALIVE, ENDED = ("Running", "heartbeat"), ("Completed", "Cancelled", *TROUBLE)


NAME = "notices of how runs end"
DEPLOYMENTS = (
    *("transfer-fleet", "ingest-structures", "ingest-demonstrations", "ingest-flights"),
    *("publish-reports", "maintain-catalog"),
)
SUBJECT = "{{ flow.name }}: {{ flow_run.state.name }}"
BODY = "{{ flow_run.name }}: {{ flow_run.state.name }}: {{ flow_run.state.message }}\n{{ flow_run|ui_url }}"


class AppriseNotice(blocks.AbstractAppriseNotificationBlock):
    """Sends to any address that Apprise knows: mail, Matrix, Telegram and many more."""

    _block_type_name = "Apprise address"
    _block_type_slug = "upplied-apprise"

    url: SecretStr = Field(description="As mailto://user:password@smtp.example.org?to=ops@example.org.")


def tell(url: str, every_run: bool = False) -> str:
    """Tell an address of the runs that fail, are lost or leave failures behind, in place of the one before.

    A webhook, one of Slack, or one of Apprise's (else a `SettingsError`); empty tells nobody any more. With
    `every_run` also of runs that went well. Returns what was set up, in words.
    """
    if not url:
        with get_client(sync_client=True) as client:
            for older in client.read_automations_by_name(NAME):
                client.delete_automation(older.id)
        return "no notices are sent"
    names, block = (*TROUBLE, "Completed") if every_run else TROUBLE, _block(url)
    document = block.save(f"upplied-{block.get_block_type_slug()}", overwrite=True)
    match = {"prefect.resource.role": "deployment", "prefect.resource.name": list(DEPLOYMENTS)}
    trigger = EventTrigger(
        posture=Posture.Reactive,
        expect={f"prefect.flow-run.{name}" for name in names},
        match={"prefect.resource.id": "prefect.flow-run.*"},
        match_related=match,
        threshold=1,
    )
    actions = [SendNotification(block_document_id=document, subject=SUBJECT, body=BODY)]
    about = "Set up by `upplied fleet notify`."
    apply(AutomationCore(name=NAME, description=about, trigger=trigger, actions=actions))
    place = urlsplit(url).hostname or urlsplit(url).scheme
    return f"{place} receives notices of runs that end {', '.join(names)}"


def _block(url: str) -> NotificationBlock:
    """What sends to an address; an error says nothing of it but its scheme, since it may hold a password."""
    try:
        parts = urlsplit(url)
    except ValueError:
        parts = urlsplit("")
    if parts.hostname == "hooks.slack.com":
        return blocks.SlackWebhook(url=url)
    if parts.scheme in ("http", "https") and parts.hostname:
        template = {"text": "{{subject}}\n{{body}}", "subject": "{{subject}}", "body": "{{body}}"}
        return blocks.CustomWebhookNotificationBlock(name="upplied", url=url, json_data=template)
    block = AppriseNotice(url=SecretStr(url))
    if not len(block._apprise_client):
        rule = (
            "http://..., https://..., or an address of Apprise's, as mailto://user:password@smtp.example.org"
        )
        raise SettingsError(f"address {parts.scheme}:...", "no message can be sent to it", rule)
    return block


def zombies(silence_s: int = SILENCE_S) -> AutomationCore:
    """Mark a run crashed that was heard of, and then not for so many seconds."""
    message = f"No sign of life for {silence_s} s: the run was killed together with its worker."
    return AutomationCore(
        name="a silent run is marked crashed",
        description="A run that was killed together with its worker says no more, and would stay Running.",
        trigger=EventTrigger(
            posture=Posture.Proactive,
            # Armed before the first heartbeat, which a run may not live to send.
            after={f"prefect.flow-run.{sign}" for sign in ("Pending", *ALIVE)},
            expect={f"prefect.flow-run.{sign}" for sign in (*ALIVE, *ENDED)},
            match={"prefect.resource.id": "prefect.flow-run.*"},
            for_each={"prefect.resource.id"},
            threshold=1,
            within=timedelta(seconds=silence_s),
        ),
        actions=[ChangeFlowRunState(state=StateType.CRASHED, message=message)],
    )


def apply(automation: AutomationCore) -> None:
    """Put an automation in place of others of its name; the same one stays, with what it has heard."""
    with get_client(sync_client=True) as client:
        for older in client.read_automations_by_name(automation.name):
            if (older.trigger, older.actions) == (automation.trigger, automation.actions):
                return
            client.delete_automation(older.id)
    Automation(**automation.model_dump()).create()


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
