"""What an estimator returns: numbers, how well they are known, and whether to believe them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.digits import LABELS, number, ten_numbers
from steelyard.display import Display
from steelyard.estimates.geometry import FoundGeometry
from steelyard.estimates.joint_covariance import JointCovariance
from steelyard.estimates.per_mass import PER_MASS_PARAMETERS, PerMass
from steelyard.inertia import BODY_PARAMETERS, BODY_UNITS, Inertia, symmetric
from steelyard.robot.model import Robot
from steelyard.tables import Tabular

FORMAT = "steelyard-estimate/1"
BEST_FIRST = (
    "maximum-likelihood",
    "consistent",
    "recursive",
    "least-squares",
    "instrumental-variables",
    "two-step",
    "force-free",
)
"""Which estimate is the ``result`` where several ran."""

Label = Literal["data", "prior", "unidentifiable"]


@dataclass(frozen=True)
class Verdict:
    """Whether an estimate can be relied on."""

    accepted: bool | None
    """None: the method is a baseline, whose model was not tested."""
    reasons: tuple[str, ...]
    """Why not, in words and numbers."""
    parameters: Mapping[str, Label]
    """Body parameter -> what determined it."""
    disagreement: str = ""
    """That other methods, whose models were tested too, say the opposite, with both reasons; empty:
    none does."""

    def __str__(self) -> str:
        if self.accepted is None:
            return self.short
        why = "" if self.accepted else f": {'; '.join(self.reasons) or 'no reason given'}"
        return f"{self.short}{why}{self.disagreement and f'; {self.disagreement}'}"

    @property
    def short(self) -> str:
        """In two or three words, without reasons."""
        if self.accepted is None:
            return "baseline, not assessed"
        return "accepted" if self.accepted else "not accepted"

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of the contract."""
        return {
            "accepted": self.accepted,
            "reasons": list(self.reasons),
            "parameters": dict(self.parameters),
            **({"disagreement": self.disagreement} if self.disagreement else {}),
        }


@dataclass(frozen=True, eq=False)
class Estimate(Tabular):
    """Ten parameters of a body with their covariance; NaN where the data do not determine one.

    It shows itself as a table: values with 1-sigma, what the data alone did not determine, and the
    verdict.
    """

    method: str
    value: Array
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10,)."""
    covariance: Array
    """Shape (10, 10)."""
    verdict: Verdict
    calibration: Mapping[str, Any] = field(default_factory=dict)
    """Instrument -> term -> ``value`` and ``standard_deviation``, as in the contract."""
    residuals: Mapping[str, Any] = field(default_factory=dict)
    """Residuals of the model, root mean square per axis."""
    runs: Mapping[str, Estimate] = field(default_factory=dict)
    """The same from every run alone, where the method has that."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """How it was made."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
    per_mass: PerMass | None = None
    """Centre of gravity and inertia over mass, where the mass is not measured by the forces."""
    geometry: FoundGeometry | None = None
    """Of the robot, as it was found beside these."""
    loads: LoadEstimates | None = None
    """Of all loads, where an experiment has several; this one is of the first."""

    @property
    def mass(self) -> float:
        """Of the body [kg]."""
        return float(self.value[0])

    @property
    def center_of_gravity(self) -> Array:
        """In the platform frame [m], shape (3,)."""
        return self.value[1:4]

    @property
    def inertia(self) -> Array:
        """About the centre of gravity, platform axes; products are elements of the matrix [kg m^2],
        shape (3, 3).
        """
        return symmetric(self.value[4:])

    @property
    def standard_deviation(self) -> Array:
        """1-sigma of the ten, shape (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def body(self) -> Inertia | None:
        """The body, where all ten are known."""
        return Inertia.from_body_parameters(self.value) if np.isfinite(self.value).all() else None

    @property
    def physical(self) -> bool | None:
        """Whether such a body can exist; None where too few numbers are known."""
        if self.body is not None:
            return self.body.is_physical
        known = self.value[
            np.isfinite(self.value) & np.isin(BODY_PARAMETERS, ("mass", "Jxx", "Jyy", "Jzz"))
        ]
        return False if (known <= 0).any() else None

    def about(self, point: Array) -> Estimate:
        """The same in a platform frame whose origin is at a point of the present one; other loads
        and runs stay as they are.

        Args:
            point: In the platform frame [m], shape (3,).
        """
        if not point.any():
            return self
        value = self.value.copy()
        value[1:4] -= point
        return replace(
            self,
            value=value,
            per_mass=None if self.per_mass is None else self.per_mass.about(point),
            geometry=None if self.geometry is None else self.geometry.about(point),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of the contract."""
        entries: dict[str, Any] = {
            **named(self.value),
            "standard_deviation": named(self.standard_deviation),
            "covariance": {"parameters": list(BODY_PARAMETERS), "matrix": plain(self.covariance)},
            "physical": self.physical,
            "calibration": plain(self.calibration),
            "verdict": self.verdict.to_dict(),
        }
        if self.per_mass is not None:
            entries["inertia_per_mass"] = plain(self.per_mass.inertia)
            spread = plain(symmetric(self.per_mass.standard_deviation[3:]))
            entries["standard_deviation"]["inertia_per_mass"] = spread
            entries["covariance_per_mass"] = {
                "parameters": list(PER_MASS_PARAMETERS),
                "matrix": plain(self.per_mass.covariance),
            }
        if self.geometry is not None:
            entries["geometry"] = self.geometry.to_dict()
        if self.loads is not None:
            entries |= self.loads.to_dict()
        if self.residuals:
            entries["residuals"] = plain(self.residuals)
        if self.details:
            entries["details"] = plain(self.details)
        if self.notes:
            entries["notes"] = list(self.notes)
        if self.runs:
            entries["runs"] = {name: run.to_dict() for name, run in self.runs.items()}
        return entries

    def columns(self) -> dict[str, Array | Sequence[str]]:
        """Ten rows: ``parameter``, ``unit``, ``value`` and ``sigma`` in SI, ``label``: data, prior
        or unidentifiable.
        """
        return {
            "parameter": BODY_PARAMETERS,
            "unit": BODY_UNITS,
            "value": self.value,
            "sigma": self.standard_deviation,
            "label": [self.verdict.parameters.get(name, "") for name in BODY_PARAMETERS],
        }

    def __repr__(self) -> str:
        return self._display().text()

    def _repr_html_(self) -> str:
        return self._display().html()

    def _display(self) -> Display:
        """A table of the ten and the verdict."""
        numbers = ten_numbers(self.value, self.standard_deviation)
        labels = [self.verdict.parameters.get(name, "") for name in BODY_PARAMETERS]
        rows = zip(LABELS, numbers, labels, strict=True)
        cells = [
            (name, unit, shown, "" if label == "data" else label)
            for (name, unit, _), shown, label in rows
        ]
        if self.per_mass is not None:
            cells += [(*each, "") for each in per_mass_rows(self.per_mass)]
        disagreement = (self.verdict.disagreement,) if self.verdict.disagreement else ()
        count = (f"notes: {len(self.notes)}",) if self.notes else ()
        return Display(
            f"{self.method}: {self.verdict.short}",
            tuple(cells),
            sentences=(*self.verdict.reasons, *disagreement, *count),
        )


@dataclass(frozen=True, eq=False)
class LoadEstimates:
    """Estimates of all loads of an experiment by one method."""

    estimates: Mapping[str, Estimate]
    """Name of a load -> its estimate."""
    joint: JointCovariance
    differences: Mapping[str, Estimate] = field(default_factory=dict)
    """``with-fork - empty`` -> the body that the one is more than the other."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of the contract."""
        return {
            "loads": {name: each.to_dict() for name, each in self.estimates.items()},
            "joint": {"loads": list(self.joint.loads), "matrix": plain(self.joint.matrix)},
            "differences": {name: each.to_dict() for name, each in self.differences.items()},
        }


def per_mass_rows(found: PerMass) -> list[tuple[str, str, str]]:
    """Name, unit and value with 1-sigma of the inertia over mass, element by element."""
    pairs = zip(found.value[3:], found.standard_deviation[3:], strict=True)
    shown = [number(v, s) if np.isfinite(v) else number(None) for v, s in pairs]
    names = [f"{name} / mass" for name, *_ in LABELS[4:]]
    return [(name, "m²", text) for name, text in zip(names, shown, strict=True)]


def named(ten: Array) -> dict[str, Any]:
    """Ten values under the names of the contract; NaN as None."""
    return {
        "mass": plain(ten[0]),
        "center_of_gravity": plain(ten[1:4]),
        "inertia": plain(symmetric(ten[4:])),
    }


def plain(value: Any) -> Any:
    """Arrays as lists, NaN and infinity as None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


_IDENTIFIABLE = 0.5
"""Part of its plausible size that the 1-sigma of an identifiable parameter stays below: with more,
the data hardly say more than what is plausible anyway."""
_BODY_ON_SENSOR = 0.3
"""Plausible radius of a body on a wrench sensor [m]; a platform on cables shows its own."""


def plausible_radius(robot: Robot) -> float:
    """Plausible radius of the body on a robot [m]."""
    return robot.size if robot.m else _BODY_ON_SENSOR


def plausible_sizes(mass: float, size: float) -> Array:
    """How large the ten of :data:`steelyard.inertia.BODY_PARAMETERS` may well be, shape (10,).

    No product of inertia exceeds half of the moment about the third axis.

    Args:
        mass: [kg]
        size: Plausible radius of the body [m].
    """
    moment = abs(mass) * size**2
    return np.array([abs(mass), *[size] * 3, *[moment] * 3, *[moment / 2] * 3])


def identifiable_parameters(mass: float, covariance: Array, size: float) -> NDArray[np.bool_]:
    """Which of the ten are known better than half of their plausible size, shape (10,).

    Args:
        mass: As estimated [kg].
        covariance: Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10).
        size: Plausible radius of the body [m].
    """
    largest = _IDENTIFIABLE * plausible_sizes(mass, size)
    known: NDArray[np.bool_] = np.sqrt(np.diag(covariance)) < largest
    # Without the mass there is no body to say anything about.
    return known if known[0] else np.zeros(10, dtype=bool)


def no_estimate(method: str, reason: str) -> Estimate:
    """An estimate of which every number is unknown."""
    return Estimate(
        method=method,
        value=np.full(10, np.nan),
        covariance=np.full((10, 10), np.nan),
        verdict=Verdict(False, (reason,), dict.fromkeys(BODY_PARAMETERS, "unidentifiable")),
    )


def judge(
    value: Array, *, reasons: Sequence[str] = (), by_prior: Sequence[bool] = (False,) * 10
) -> Verdict:
    """The checks that every method's result goes through, added to its own reasons.

    Args:
        value: The ten, NaN where the data do not determine one, shape (10,).
        reasons: Why else not to accept it.
        by_prior: Which of the ten prior knowledge of the body determines rather than the data,
            shape (10,).
    """
    found = list(reasons)
    if np.isnan(value[0]):
        found.append("the mass is not identifiable from these data")
    elif value[0] <= 0:
        found.append(f"the mass is not positive: {value[0]:.4g} kg")
    elif (value[4:7] <= 0).any():
        found.append(f"a moment of inertia is not positive: {np.nanmin(value[4:7]):.4g} kg m^2")
    elif np.isfinite(value).all():
        body = Inertia.from_body_parameters(value)
        if not body.is_physical:
            i1, i2, i3 = body.principal_moments
            why = "the smallest not positive"
            if i1 > 0:
                why = f"the largest {-body.triangle_margin:.3g} kg m^2 beyond the sum of the others"
            found.append(
                f"no body has this inertia: principal moments {i1:.4g}, {i2:.4g} and {i3:.4g} kg"
                f" m^2, {why}"
            )
    labels: dict[str, Label] = {
        name: "unidentifiable" if np.isnan(v) else "prior" if prior else "data"
        for name, v, prior in zip(BODY_PARAMETERS, value, by_prior, strict=True)
    }
    return Verdict(accepted=not found, reasons=tuple(found), parameters=labels)


def unassessed(verdict: Verdict) -> Verdict:
    """The verdict on a baseline: a body that cannot exist is refused, but nothing else was
    tested.
    """
    if not verdict.accepted:
        return verdict
    why = (
        "a baseline, whose model is not tested: its 1-sigma comes from the residuals, errors of the"
        " geometry and noise in the motion are not in it"
    )
    return replace(verdict, accepted=None, reasons=(why,))
