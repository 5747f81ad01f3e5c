"""The keeper commits what came in, once, and nobody who hands something in waits for it."""

from __future__ import annotations

import hashlib
import threading

import pytest

from upplied.config import settings_for
from upplied.errors import CatalogError
from upplied.fleet import run
from upplied.fleet.decisions import Job
from upplied.fleet.planner import Outcome
from upplied.records import Plan

PATIENCE_S = 60.0


class Commits:
    """Stands for a catalog: holds a commit up until it may go on, and fails when told to."""

    def __init__(self) -> None:
        self.batches: list[list[str]] = []
        self.began, self.go_on = threading.Event(), threading.Event()
        self.full = False
        self.go_on.set()

    def add_plans(self, plans) -> None:
        self.began.set()
        assert self.go_on.wait(PATIENCE_S)
        if self.full:
            raise CatalogError("transfers", "No space left on device")
        self.batches.append([key for key, _, _ in plans])


def outcome(number: int) -> Outcome:
    key = hashlib.sha256(str(number).encode()).hexdigest()
    job = Job(
        "flight", "source", f"t{number}", "box", settings_for("paper"), key, "new pair", ("a", "b", "c")
    )
    return Outcome(job, Plan("flight", "source", f"t{number}", "box", "paper", "ok"), 0.1)


@pytest.fixture
def commits(monkeypatch) -> Commits:
    monkeypatch.setattr(run, "BATCH", 3)
    return Commits()


def test_outcomes_come_in_while_others_are_committed(commits):
    keeper = run.Keeper(commits, "run")
    commits.go_on.clear()
    slow = threading.Thread(target=lambda: [keeper.add(outcome(number)) for number in range(3)])
    slow.start()
    assert commits.began.wait(PATIENCE_S)
    quick = threading.Thread(target=lambda: [keeper.add(outcome(number)) for number in (3, 4)])
    quick.start()
    quick.join(PATIENCE_S)
    assert not quick.is_alive() and commits.batches == []
    commits.go_on.set()
    slow.join(PATIENCE_S)
    keeper.close()
    assert [len(batch) for batch in commits.batches] == [3, 2]
    assert all(batch == sorted(batch) for batch in commits.batches)
    assert keeper.result.ok == 5


def test_what_could_not_be_committed_is_tried_again_at_the_end(commits):
    keeper = run.Keeper(commits, "run")
    commits.full = True
    with pytest.raises(CatalogError, match="No space"):
        for number in range(3):
            keeper.add(outcome(number))
    commits.full = False
    keeper.close()
    keeper.close()
    assert [len(batch) for batch in commits.batches] == [3]
