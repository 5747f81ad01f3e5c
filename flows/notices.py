"""Telling somebody how runs end: an automation of Prefect's that writes to a webhook, Slack or by mail."""

from __future__ import annotations

from urllib.parse import urlsplit

from prefect import get_client
from prefect.automations import Automation, AutomationCore, EventTrigger, Posture, SendNotification
from prefect.blocks import notifications as blocks
from prefect.blocks.abstract import NotificationBlock
from pydantic import Field, SecretStr

from upplied.errors import SettingsError

from .states import TROUBLED

NAME = "notices of how runs end"
TROUBLE = ("Failed", "Crashed", "TimedOut", TROUBLED)
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

    The address is a webhook, one of Slack, or one of Apprise's; empty tells nobody any more. With `every_run`
    it is told of runs that went well, too. Returns what was set up, in words.

    Raises
    ------
    SettingsError
        If nothing can be sent to that address; whoever was told before still is.
    """
    block = _block(url) if url else None
    names = (*TROUBLE, "Completed") if every_run else TROUBLE
    with get_client(sync_client=True) as client:
        before = [older.id for older in client.read_automations_by_name(NAME)]
        if block is not None:
            document = block.save(f"upplied-{block.get_block_type_slug()}", overwrite=True)
            Automation(**_automation(document, names).model_dump()).create()
        for older in before:
            client.delete_automation(older)
    if block is None:
        return "no notices are sent"
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


def _automation(document: object, names: tuple[str, ...]) -> AutomationCore:
    return AutomationCore(
        name=NAME,
        description="Set up by `upplied fleet notify`.",
        trigger=EventTrigger(
            posture=Posture.Reactive,
            expect={f"prefect.flow-run.{name}" for name in names},
            match={"prefect.resource.id": "prefect.flow-run.*"},
            match_related={"prefect.resource.role": "deployment", "prefect.resource.name": list(DEPLOYMENTS)},
            threshold=1,
        ),
        actions=[SendNotification(block_document_id=document, subject=SUBJECT, body=BODY)],
    )
