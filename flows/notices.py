"""Telling somebody how runs end: an automation of Prefect's that writes to a webhook, Slack or by mail."""

from __future__ import annotations

from urllib.parse import urlsplit

from prefect import get_client
from prefect.automations import Automation, AutomationCore, EventTrigger, Posture, SendNotification
from prefect.blocks.abstract import NotificationBlock
from prefect.blocks.notifications import (
    AbstractAppriseNotificationBlock,
    CustomWebhookNotificationBlock,
    SlackWebhook,
)
from pydantic import Field, SecretStr

from .states import TROUBLED

NAME = "somebody is told how runs end"
TROUBLE = ("Failed", "Crashed", "TimedOut", TROUBLED)
DEPLOYMENTS = (
    "transfer-fleet",
    "ingest-structures",
    "ingest-demonstrations",
    "ingest-flights",
    "publish-reports",
    "maintain-catalog",
)
SUBJECT = "{{ flow.name }}: {{ flow_run.state.name }}"
BODY = "{{ flow_run.name }}: {{ flow_run.state.name }}: {{ flow_run.state.message }}\n{{ flow_run|ui_url }}"


class AppriseNotice(AbstractAppriseNotificationBlock):
    """Sends to any address that Apprise knows: mail, Matrix, Telegram and many more."""

    _block_type_name = "Apprise address"
    _block_type_slug = "upplied-apprise"

    url: SecretStr = Field(description="As mailto://user:password@smtp.example.org?to=ops@example.org.")


def tell(url: str, every_run: bool = False) -> str:
    """Tell an address of the runs that fail, are lost or leave failures behind, in place of the one before.

    Parameters
    ----------
    url : str
        A webhook, one of Slack, or an address of Apprise's; empty tells nobody any more.
    every_run : bool
        Of runs that went well, too.

    Returns
    -------
    str
        What was set up, in words.
    """
    with get_client(sync_client=True) as client:
        for older in client.read_automations_by_name(NAME):
            client.delete_automation(older.id)
    if not url:
        return "nobody is told"
    block = _block(url)
    document = block.save(f"upplied-{block.get_block_type_slug()}", overwrite=True)
    names = (*TROUBLE, "Completed") if every_run else TROUBLE
    Automation(**_automation(document, names).model_dump()).create()
    return f"{urlsplit(url).hostname or urlsplit(url).scheme} is told of runs that end {', '.join(names)}"


def _block(url: str) -> NotificationBlock:
    """What sends to an address."""
    parts = urlsplit(url)
    if parts.hostname == "hooks.slack.com":
        return SlackWebhook(url=url)
    if parts.scheme in ("http", "https"):
        said = {"text": "{{subject}}\n{{body}}", "subject": "{{subject}}", "body": "{{body}}"}
        return CustomWebhookNotificationBlock(name="upplied", url=url, json_data=said)
    return AppriseNotice(url=SecretStr(url))


def _automation(document: object, names: tuple[str, ...]) -> AutomationCore:
    return AutomationCore(
        name=NAME,
        description="Set up by `upplied fleet notify`.",
        trigger=EventTrigger(
            posture=Posture.Reactive,
            expect={f"prefect.flow-run.{name}" for name in names},
            match={"prefect.resource.id": "prefect.flow-run.*"},
            match_related={
                "prefect.resource.role": "deployment",
                "prefect.resource.name": list(DEPLOYMENTS),
            },
            threshold=1,
        ),
        actions=[SendNotification(block_document_id=document, subject=SUBJECT, body=BODY)],
    )
