"""An excerpt with all agreements between its instruments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.agreement import InstrumentAgreement
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.motion import (
    Relation,
    is_of_motion,
    motion_agreement,
    motion_relations,
)
from steelyard.inspection.agreements.wrench_balance import (
    force_agreement,
    force_relations,
    has_body,
)


@dataclass(frozen=True, eq=False)
class Judged:
    """An excerpt and all its agreements."""

    excerpt: Excerpt
    agreements: Mapping[Relation, InstrumentAgreement]

    @property
    def bad(self) -> list[InstrumentAgreement]:
        """Of instruments that contradict each other."""
        return [a for a in self.agreements.values() if not a.agrees]

    @property
    def worst_of_forces(self) -> float:
        """Largest ratio of the agreements of forces with a motion."""
        ratios = (a.worst for relation, a in self.agreements.items() if has_body(relation))
        return max(ratios, default=0.0)

    def suspects(self, least: float) -> list[Source]:
        """Readings that contradict most of those they are compared with, the worst first: what is
        wrong agrees with nothing.

        Args:
            least: Share of contradictions, as a part of the largest share.
        """
        contradicted: dict[Source, list[bool]] = {}
        for relation, agreement in self.agreements.items():
            for source in relation[1]:
                contradicted.setdefault(source, []).append(not agreement.agrees)
        share = {source: sum(each) / len(each) for source, each in contradicted.items()}
        most = max(share.values())
        found = [s for s in share if share[s] > 0 and share[s] >= least * most]
        return sorted(found, key=lambda s: -share[s])


def judged(excerpt: Excerpt) -> Judged:
    """Evaluate everything that can be compared."""
    relations = (*motion_relations(excerpt), *force_relations(excerpt))
    found = {r: a for r in relations if (a := evaluated(excerpt, r)) is not None}
    return Judged(excerpt, found)


def evaluated(excerpt: Excerpt, relation: Relation) -> InstrumentAgreement | None:
    """One agreement; None where it cannot be had."""
    evaluate = motion_agreement if is_of_motion(relation) else force_agreement
    try:
        found = evaluate(excerpt, relation)
    except np.linalg.LinAlgError:
        return None
    if found is None or not np.isfinite(found.ratio).all():
        return None
    if has_body(relation) and excerpt.experiment.moves_within(excerpt.run.name):
        # What swings pulls as it likes; mistakes leave far more.
        return replace(found, bad=found.bad * excerpt.settings.moving_within)
    return found
