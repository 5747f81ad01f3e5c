"""How a run ended, in a state that an alert can tell from another, and a message for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from inspect import signature
from typing import TYPE_CHECKING, ParamSpec

from prefect.states import Completed, Failed, State

from upplied.errors import UppliedError

if TYPE_CHECKING:
    from .engines import Planned

TROUBLED = "CompletedWithFailures"  # the run did its work, and some of it failed
LAST_WORDS = 3  # of what failed, in a state's message; the artifact has them all

P = ParamSpec("P")


def errors_in_words(flow: Callable[P, State]) -> Callable[P, State]:
    """A flow whose errors that a person can mend end it in their own words, not in a traceback."""

    @wraps(flow)
    def run(*args: P.args, **kwargs: P.kwargs) -> State:
        try:
            return flow(*args, **kwargs)
        except UppliedError as error:
            return Failed(message=str(error))
        except OSError as error:  # of the machine: a full disk, a right that is missing
            return Failed(message=f"{error.filename or type(error).__name__}: {error.strerror or error}")

    # Prefect makes its form of the parameters from these, in whose module the names may not be known.
    run.__signature__ = signature(flow, eval_str=True)  # type: ignore[attr-defined]
    return run


def planned(summary: str, outcome: Planned, problems: Sequence[str], most_lost: float) -> State:
    """The state of a run that planned: failed where all of it failed, or the engine lost more than its share.

    `problems` went wrong besides; `most_lost` is the share of shards that the engine may lose.
    """
    failures = [f"{job}: {reason}" for job, status, reason in outcome.result.troubles if status == "failed"]
    message = ". ".join(filter(None, (summary, outcome.loss)))
    if len(outcome.lost) > most_lost * outcome.shards:
        return Failed(message=f"{message}. More than {most_lost:.0%} of the shards were lost")
    recalls = [text for text in problems if text.startswith("RECALLED")]  # before all else
    others = [text for text in problems if text not in recalls]
    every = bool(failures) and len(failures) == outcome.result.total
    return ended(message, [*recalls, *failures, *others], every)


def ingested(summary: str, files: Sequence[dict[str, str]]) -> State:
    """The state of a run that read files: failed where none could be read."""
    failures = [item["reason"] for item in files if item["status"] == "failed"]
    return ended(summary, failures, bool(failures) and len(failures) == len(files))


def ended(summary: str, problems: Sequence[str], all_failed: bool = False) -> State:
    """Completed; completed with failures where there are problems, the first of which are told; or failed."""
    if not problems:
        return Completed(message=summary)
    more = f"; and {len(problems) - LAST_WORDS} more" if len(problems) > LAST_WORDS else ""
    message = f"{summary}. {'; '.join(problems[:LAST_WORDS])}{more}"
    return Failed(message=message) if all_failed else Completed(name=TROUBLED, message=message)
