"""Which looks of a flight count as sharp: how far the expert's own blur and incidence widen what is asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.config import InspectionSettings
from upplied.planning.demonstration.repetition import Take
from upplied.planning.geometry.percentile import weighted_percentile
from upplied.planning.visibility.moments import moments

USUAL_PCT = 95.0  # of the demonstration's time


def look_limits(takes: Sequence[Take], rule: InspectionSettings) -> tuple[float, float]:
    """Largest motion (rad/s) and least cosine of the incidence of a look that counts.

    Those of the settings, unless 95 % of the expert's own looks were within a wider one.
    """
    attended = [take.inspection.attention for take in takes]
    sharp = max(_sharp_radps(takes, rule), *(one.motion_radps for one in attended))
    oblique = max(rule.max_incidence_deg, *(one.incidence_deg for one in attended))
    return float(sharp), float(np.cos(np.radians(min(oblique, 90.0))))


def steady_radps(takes: Sequence[Take], rule: InspectionSettings) -> float:
    """How fast the camera may turn, rad/s: while it is sharp, or as the expert did 95 % of the time."""
    flown = [moments(take.inspection.logged, take.inspection.logged_breaks) for take in takes]
    own = np.concatenate([np.linalg.norm(part.turn, axis=1) for part in flown])
    time = np.concatenate([part.step_s for part in flown])
    usual = weighted_percentile(own, time, USUAL_PCT)
    return max(_sharp_radps(takes, rule), 0.0 if np.isnan(usual) else usual)


def _sharp_radps(takes: Sequence[Take], rule: InspectionSettings) -> float:
    camera = takes[0].inspection.camera
    return rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
