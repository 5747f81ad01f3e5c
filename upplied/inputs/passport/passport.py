"""A flight's passport: its figures and the rules it breaks, as it is stored, and as a refusal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from upplied.inputs.passport.measured import Measured, Reading, measure
from upplied.inputs.passport.rules import judged
from upplied.inputs.rules import Verdict, refusals, refuse
from upplied.inputs.sidecar import LogOptions
from upplied.records import Structure


def passport_of(reading: Reading, structure: Structure, facts: LogOptions, what: str) -> Mapping[str, Any]:
    """The passport of a flight, in plain values.

    Raises InputError if a rule is broken that refuses and is not overruled.
    """
    measured = measure(reading, structure, facts.passport)
    verdicts = (*reading.overruled, *judged(measured, facts.passport, facts.allow, facts.strict))
    refuse(f"{what}, flown on {facts.structure_id}", _with_hint(verdicts, measured))
    overruled = any(verdict.overruled for verdict in verdicts)
    return {
        "verdict": "overruled" if overruled else "warned" if verdicts else "good",
        "findings": [asdict(verdict) for verdict in verdicts],
        "allowed": sorted(facts.allow),
        "structure_sha256": structure.sha256,
        "measured": _plain(asdict(measured)),
        "bounds": _plain(asdict(facts.passport)),
    }


def findings_of(passport: Mapping[str, Any]) -> tuple[Verdict, ...]:
    """The rules that a flight was found to break; none where it has no passport."""
    return tuple(Verdict(**item) for item in passport.get("findings", ()))


def _with_hint(verdicts: tuple[Verdict, ...], measured: Measured) -> list[Verdict]:
    """What is refused, the last of it with the convention that comes nearest to making sense of it."""
    found = list(verdicts)
    names = {verdict.rule for verdict in refusals(verdicts)}
    if (
        names
        and not names & {"fits-otherwise", "stand-off"}
        and measured.other_fit_pct - measured.fit_pct >= 5
    ):
        share = f"{measured.other_fit_pct:.0f} %, as given {measured.fit_pct:.0f} %"
        hint = f"; the nearest other convention, {measured.other_words} ({measured.other}), fits {share}"
        last = max(at for at, verdict in enumerate(found) if verdict.rule in names)
        found[last] = replace(found[last], found=found[last].found + hint)
    return found


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers rounded to what they are worth; None for what is not finite."""
    return {name: _rounded(value) for name, value in values.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 3) if math.isfinite(value) else None
    return [_rounded(item) for item in value] if isinstance(value, tuple | list) else value
