"""What Prefect does by itself: a run whose heart stopped is marked crashed, and its slot is free again.

``python -m upplied.flows.automations`` applies it to the server of the environment; again is as once.
"""

from __future__ import annotations

from datetime import timedelta

from prefect import get_client
from prefect.automations import Automation, AutomationCore, ChangeFlowRunState, EventTrigger, Posture
from prefect.client.schemas.objects import StateType

from .environment import SETTINGS
from .notices import TROUBLE

HEARTBEAT_S = int(SETTINGS["PREFECT_FLOWS_HEARTBEAT_FREQUENCY"])
# Ten beats: a loaded server that answers late, or drops some events, must not kill a healthy run.
SILENCE_S = 10 * HEARTBEAT_S
ALIVE, ENDED = ("Running", "heartbeat"), ("Completed", "Cancelled", *TROUBLE)  # events of a run


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
    """Put an automation in place of others of its name; the same one stays.

    With it stays what it has heard: of the runs that a power cut ended, no server will hear again.
    """
    with get_client(sync_client=True) as client:
        for older in client.read_automations_by_name(automation.name):
            if (older.trigger, older.actions) == (automation.trigger, automation.actions):
                return
            client.delete_automation(older.id)
    Automation(**automation.model_dump()).create()


if __name__ == "__main__":
    apply(zombies())
