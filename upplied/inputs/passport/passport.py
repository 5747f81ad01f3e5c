"""A flight's passport: its figures and the rules it breaks, as it is stored, and as a refusal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from upplied.errors import InputError, SettingsError
from upplied.inputs.passport.measured import Measured, Reading, measure
from upplied.inputs.passport.rules import NAMES, Finding, judged
from upplied.inputs.sidecar import LogOptions
from upplied.records import Structure

VERDICTS = ("good", "warned", "overruled")


def check_names(allow: tuple[str, ...]) -> None:
    """Refuse the name of a rule that does not exist.

    Raises
    ------
    SettingsError
    """
    for name in allow:
        if name not in NAMES:
            raise SettingsError(f"--allow {name}", "is no rule", f"one of {', '.join(NAMES)}")


def passport_of(reading: Reading, structure: Structure, facts: LogOptions, what: str) -> Mapping[str, Any]:
    """The passport of a flight, in plain values.

    Raises
    ------
    InputError
        If a rule is broken that refuses and is not overruled.
    """
    measured = measure(reading, structure, facts.passport)
    findings = judged(measured, facts.passport, facts.allow, facts.strict)
    refused = [finding for finding in findings if finding.verdict == "refused"]
    if refused:
        raise _refusal(refused, measured, facts, what)
    verdicts = {finding.verdict for finding in findings}
    return {
        "verdict": "overruled" if "allowed" in verdicts else "warned" if findings else "good",
        "findings": [asdict(finding) for finding in findings],
        "allowed": sorted(facts.allow),
        "structure_sha256": structure.sha256,
        "measured": _plain(asdict(measured)),
        "bounds": _plain(asdict(facts.passport)),
    }


def _refusal(refused: list[Finding], measured: Measured, facts: LogOptions, what: str) -> InputError:
    names = [finding.rule for finding in refused]
    remedies = list(dict.fromkeys(filter(None, (finding.remedy for finding in refused))))
    hint = ""
    if "fits-otherwise" not in names and measured.other_fit_pct - measured.fit_pct >= 5:
        share = f"{measured.other_fit_pct:.0f} %, as given {measured.fit_pct:.0f} %"
        hint = f"; the nearest other convention, {measured.other_words} ({measured.other}), fits {share}"
    return InputError(
        f"{what}, flown on {facts.structure_id}",
        "; ".join(map(str, refused)) + hint,
        ", ".join(names),
        f"{'; '.join(remedies[:3])}; or overrule: {' '.join(f'--allow {name}' for name in names)}",
    )


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers rounded to what they are worth; None for what is not finite."""
    return {name: _rounded(value) for name, value in values.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 3) if math.isfinite(value) else None
    return [_rounded(item) for item in value] if isinstance(value, tuple | list) else value
