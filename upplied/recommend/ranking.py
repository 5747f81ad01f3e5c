"""Ranking of the demonstrations of a catalog for a structure, with reasons and without planning.

Shapes are compared by their cached features, thousands at once. The few most similar structures are
registered, and the visibility of their inspected surface on the target is predicted. All results are
cached by content in the catalog's cache; plans reuse the clouds and registrations.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import camera_of
from upplied.checks import check_id
from upplied.config import Settings, settings_for
from upplied.errors import InputError
from upplied.planning.correspondence.memo import content_key
from upplied.planning.correspondence.registration import fitted
from upplied.planning.geometry.clouds import diagonal_of
from upplied.recommend.foresee import FORESIGHT_VERSION, Agreement, Foreseen, agreement, foresee
from upplied.recommend.shapes import Shapes, content_of, unlikeness
from upplied.records import Floats, Registration

R = TypeVar("R")

# Limit of misfit plus unlikeness, each about 1 at most for corresponding structures. With equal boxes a
# cooling tower fits a ship well: if only one of the two is small, a person should compare the structures.
_SURE = 1.5
# Added for another declared kind: as much as the acceptance limit of unlikeness.
_OTHER_KIND = 1.0
_SOURCES, _FLIGHTS = 6, 60  # registered structures, and flights on them with a prediction


@dataclass(frozen=True)
class Recommendation:
    """One demonstration with the predicted result of its transfer to the target."""

    rank: int
    demonstration_id: str
    source_id: str
    kind: str  # as declared of the source
    verdict: str  # "own", "fits", "doubtful" or "refused", as in planning
    misfit: float  # of the structures, lower is better; the limit is `RegistrationSettings.acceptance`
    predicted_seen_pct: float  # least `coverage_seen_pct` of a plan; NaN: nothing to see
    without_pct: float  # share of the inspected surface without a counterpart on the target
    inspected_pct: float  # of the source's surface
    unlikeness: float  # of the shapes, which selects the candidates
    why: str


def recommend(
    catalog: Catalog, structure_id: str, most: int = 10, by_kind: bool = True
) -> list[Recommendation]:
    """The demonstrations that would transfer best to a structure, best first.

    Flights of the structure itself come first: they need no transfer. Flights that fit by shape follow,
    then the others by similarity. Another declared kind counts against a flight, but a good fit of the shapes
    outweighs it.

    At most `most` are given, of the few most similar structures. Unless declared kinds count (`by_kind`),
    only the shape decides. An InputError is raised if the catalog lacks the structure, or has no
    demonstration with its structure.
    """
    check_id(structure_id, "structure id")
    structures = catalog.structures().set_index("structure_id")
    if structure_id not in structures.index:
        some = ", ".join(sorted(structures.index)[:10]) or "none"
        raise InputError(f"structure {structure_id!r}", "is not in the catalog", f"known: {some}")
    flights = catalog.demonstrations()
    flights = flights[flights["structure_id"].isin(structures.index)]
    if not len(flights):
        finding, remedy = "has no demonstration of any of its structures", "upplied demonstrations add"
        raise InputError(f"catalog {catalog.location}", finding, remedy=f"add logs first: {remedy}")
    question = _Question(catalog, structure_id, structures, by_kind)
    judged = sorted(question.judge(row, unlike) for row, unlike in question.candidates(flights))
    return [replace(one, rank=rank) for rank, (*_, one) in enumerate(judged[:most], 1)]


class _Question:
    def __init__(self, catalog: Catalog, target_id: str, structures: pd.DataFrame, by_kind: bool) -> None:
        self.catalog, self.target_id = catalog, target_id
        self.settings: Settings = settings_for("recommended")
        self.shapes = Shapes(catalog)
        self.content = content_of(structures, "mesh_sha256")
        self.kinds = structures["kind"]
        self.other_kind = (self.kinds != self.kinds[target_id]) * (_OTHER_KIND if by_kind else 0.0)
        self.target = self.shapes.cloud(target_id, self.content[target_id])

    def candidates(self, flights: pd.DataFrame) -> list[tuple[pd.Series, float]]:
        """The flights over the structures most alike, with how unlike those are."""
        sources = sorted(set(flights["structure_id"]))
        library = self.shapes.library(self.content[sources].to_dict())
        own = self.shapes.features(self.target_id, self.content[self.target_id])
        unlike: Floats = unlikeness(own, library)
        nearest = np.argsort(unlike + self.other_kind[sources].to_numpy(), kind="stable")[:_SOURCES]
        flights = flights.assign(content=content_of(flights, "poses_sha256"))
        flights = flights.sort_values("demonstration_id")
        share = math.ceil(_FLIGHTS / len(nearest))
        return [
            (row, float(unlike[index]))
            for index in nearest
            for _, row in flights[flights["structure_id"] == sources[index]].head(share).iterrows()
        ]

    def judge(self, row: pd.Series, unlike: float) -> tuple[int, float, float, str, Recommendation]:
        """The recommendation of one flight, after its sort key.

        Fitting flights come first, by predicted coverage and certainty; the others by similarity.
        """
        source_id, flight_id = str(row["structure_id"]), str(row["demonstration_id"])
        content = self.content[source_id]
        source, clouds = self.shapes.cloud(source_id, content), self.settings.clouds
        gate = self.settings.registration.acceptance
        assert gate is not None

        def known(stage: str, kind: type[R], compute: Callable[[], R], *of: str) -> R:
            facts = (FORESIGHT_VERSION, content, self.content[self.target_id], clouds, gate, *of)
            return self.catalog.cache(stage, kind, content_key(stage, "foreseen", *facts), compute)

        registration = known("registration", Registration, lambda: fitted(source, self.target, gate))
        seen = self.shapes.inspected(flight_id, row["content"], source_id, content)
        agreed, foreseen = None, Foreseen(float("nan"), float("nan"))
        if registration.accepted:
            agreed = known("agreement", Agreement, lambda: agreement(source, self.target, registration))
            facts = (source, self.target, registration, agreed, seen, camera_of(row.to_dict()))
            foreseen = known("foreseen", Foreseen, lambda: foresee(*facts), row["content"])
        kind, misfit = str(self.kinds[source_id]), registration.acceptance
        other_kind = float(self.other_kind[source_id])
        if source_id == self.target_id:
            verdict, why = "own", f"flown on this structure; {seen.summary}"
        elif agreed is None:
            verdict, why = "refused", registration.reason
        else:
            verdict = "fits" if misfit + unlike + other_kind < _SURE else "doubtful"
            size = diagonal_of(self.target.points) / diagonal_of(source.points)
            parts = f"{agreed.parts_matched} of {agreed.parts} parts match"
            words = [f"the structures fit (misfit {misfit:.2f})"]
            words += [f"{parts} ({100 * agreed.area_matched:.0f} % by area)"]
            words += [f"size ratio {size:.2f}", seen.summary]
            if foreseen.without_pct > 0.5:
                words.append(f"{foreseen.without_pct:.0f} % of that has no counterpart here")
            if verdict == "doubtful":
                doubt = f"uncertain match (unlikeness {unlike:.2f})"
                words.append(f"{doubt}: compare both structures before flying")
            why = "; ".join(words)
        if other_kind:
            why += f"; declared to be of another kind, {kind}"
        seen_pct, without_pct = np.nan_to_num([foreseen.coverage_seen_pct, foreseen.without_pct])
        again, unlike_in_all = float(seen_pct * (100 - without_pct)) / 1e4, unlike + other_kind
        place = {"own": 0, "fits": 1}.get(verdict, 2)
        likely = -again * math.exp(-misfit - unlike_in_all) if place == 1 else unlike_in_all
        expected = (foreseen.coverage_seen_pct, foreseen.without_pct, 100 * seen.share)
        one = Recommendation(0, flight_id, source_id, kind, verdict, misfit, *expected, unlike, why)
        return place, likely, -again, flight_id, one
