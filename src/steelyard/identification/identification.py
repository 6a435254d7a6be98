"""Estimates of one experiment by all methods: what `identify` writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.clocks.offsets import Offset
from steelyard.digits import LABELS, number, ten_numbers
from steelyard.display import Display
from steelyard.estimates.estimate import BEST_FIRST, FORMAT, Estimate, named, per_mass_rows
from steelyard.experiment.model import Experiment
from steelyard.identification.model.fitted_motion import FittedMotion
from steelyard.identification.solve.bound import Bound
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.prediction import Prediction
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.tables import Tabular


@dataclass(frozen=True, eq=False)
class Identification(Tabular):
    """Estimates of one experiment; it shows itself as a table of them."""

    experiment: str
    nominal: Inertia | None
    estimates: Mapping[str, Estimate]
    predictions: tuple[Prediction, ...] = ()
    """Of runs that were held out."""
    clocks: Mapping[str, tuple[Offset, ...]] = field(default_factory=dict)
    """Run -> its clocks, where they were found from the data."""
    left_out: tuple[str, ...] = ()
    """Readings that were taken out when the recording was read, in words."""
    recorded: Experiment | None = None
    """What was looked at: without the runs held out, on one clock."""
    posterior: Posterior | None = None
    """What the best of the estimates was drawn from; None: it is a method of its own."""
    amendment: str = ""
    """YAML to merge into the experiment file, where that takes back what makes the result wrong;
    empty: nothing is known that would."""

    @property
    def bound(self) -> Bound | None:
        """What could be known at best; None where no method tells it."""
        return None if self.posterior is None else self.posterior.bound

    @property
    def motion(self) -> tuple[FittedMotion, ...]:
        """Of each stretch of the runs, as the best method has it."""
        return () if self.posterior is None else self.posterior.motion

    @property
    def result(self) -> str:
        """Name of the best method that ran, of those that have numbers where any has."""
        return best_of(self.estimates)

    @property
    def estimate(self) -> Estimate:
        """Of the best method that ran."""
        return self.estimates[self.result]

    @property
    def is_rejected(self) -> bool:
        """Whether the methods that were assessed reject the result; a baseline alone is neither
        accepted nor rejected.
        """
        if self.estimate.verdict.accepted is not None:
            return not self.estimate.verdict.accepted
        return any(each.verdict.accepted is False for each in self.estimates.values())

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of ``estimate.json``."""
        return {
            "format": FORMAT,
            "experiment": self.experiment,
            "nominal": self.nominal.to_dict() if self.nominal else None,
            "result": self.result,
            "estimates": {name: estimate.to_dict() for name, estimate in self.estimates.items()},
            **({"recordings": self.recorded.digests()} if self.recorded else {}),
            **(
                {"attainable": {"standard_deviation": named(self.bound.standard_deviation)}}
                if self.bound
                else {}
            ),
            **(
                {
                    "clocks": {
                        run: [o.to_dict() for o in found] for run, found in self.clocks.items()
                    }
                }
                if self.clocks
                else {}
            ),
            **({"left_out": list(self.left_out)} if self.left_out else {}),
            **({"amendment": self.amendment} if self.amendment else {}),
            **(
                {"holdout": {p.run: p.to_dict() for p in self.predictions}}
                if self.predictions
                else {}
            ),
        }

    def columns(self) -> dict[str, Array | Sequence[str]]:
        """Ten rows for each method: ``method``, then those of :meth:`.Estimate.columns`."""
        each = [estimate.columns() for estimate in self.estimates.values()]
        methods = [name for name in self.estimates for _ in BODY_PARAMETERS]
        return {
            "method": methods,
            **{key: np.concatenate([np.asarray(c[key]) for c in each]) for key in each[0]},
        }

    def __repr__(self) -> str:
        return self._display().text()

    def _repr_html_(self) -> str:
        return self._display().html()

    def _display(self) -> Display:
        """A table of the ten by all methods, with their verdicts."""
        columns = [
            ten_numbers(each.value, each.standard_deviation) for each in self.estimates.values()
        ]
        return Display(
            self.experiment,
            tuple(
                (name, unit, *cells)
                for (name, unit, _), *cells in zip(LABELS, *columns, strict=True)
            )
            + self._per_mass(),
            head=("", "", *self.estimates),
            sentences=(
                *(f"{name}: {each.verdict}" for name, each in self.estimates.items()),
                *(
                    [f"to merge into the experiment file: {self._in_one_line}"]
                    if self.amendment
                    else []
                ),
            ),
        )

    @property
    def _in_one_line(self) -> str:
        """What to merge, as a sentence has it."""
        return " ".join(self.amendment.split())

    def _per_mass(self) -> tuple[tuple[str, ...], ...]:
        """Rows of the inertia over mass by all methods; none where every one has the mass."""
        each = [estimate.per_mass for estimate in self.estimates.values()]
        rows = [None if found is None else per_mass_rows(found) for found in each]
        some = next((own for own in rows if own is not None), None)
        if some is None:
            return ()
        return tuple(
            (name, unit, *(number(None) if own is None else own[i][2] for own in rows))
            for i, (name, unit, _) in enumerate(some)
        )


def best_of(estimates: Mapping[str, Estimate]) -> str:
    """Name of the best method, of those that have numbers where any has."""
    ran = [name for name in BEST_FIRST if name in estimates]
    told = [name for name in ran if np.isfinite(estimates[name].value).any()]
    return (told or ran)[0]
