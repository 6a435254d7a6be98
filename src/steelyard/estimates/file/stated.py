"""What an estimate file states, as values; refused where its numbers are no estimate."""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.estimates.estimate import Estimate, Verdict
from steelyard.estimates.file.covariance_check import ROUNDED, covariance_problem
from steelyard.estimates.file.form import (
    BodyForm,
    CovarianceForm,
    EntryForm,
    GeometryForm,
    JointForm,
    NominalForm,
)
from steelyard.estimates.geometry import FoundGeometry
from steelyard.estimates.joint_covariance import JointCovariance
from steelyard.estimates.named_estimate import shortened
from steelyard.estimates.per_mass import PER_MASS_PARAMETERS, PerMass
from steelyard.files.document import YamlDocument
from steelyard.inertia import BODY_PARAMETERS, Inertia, six


def stated_nominal(document: YamlDocument, form: NominalForm | None) -> Inertia | None:
    """The body as it was drawn, refused where it cannot be one; None: nobody says."""
    if form is None:
        return None
    try:
        return Inertia(form.mass, np.array(form.center_of_gravity), np.array(form.inertia))
    except ValueError as error:
        raise document.error(("nominal",), f"{error}; correct it") from None


def stated_estimate(document: YamlDocument, key: tuple[str, ...], entry: EntryForm) -> Estimate:
    """An estimate of the file, refused where its numbers are no estimate.

    Args:
        document: The file.
        key: Where it stands, under the name of its method.
        entry: What stands there.
    """
    value = _ten(document, key, entry)
    deviation = _ten(document, (*key, "standard_deviation"), entry.standard_deviation)
    if (deviation < 0).any():
        raise document.error(
            (*key, "standard_deviation"),
            f"expected no 1-sigma below 0, found {np.nanmin(deviation):g}; correct it",
        )
    covariance = (
        np.diag(deviation**2)
        if entry.covariance is None
        else _matrix(document, key, entry.covariance)
    )
    known = np.flatnonzero(np.isfinite(np.diag(covariance)))
    block = np.ix_(known, known)
    problem = covariance_problem(covariance[block], [BODY_PARAMETERS[j] for j in known])
    if problem is not None:
        raise document.error(
            (*key, "covariance", "matrix") if entry.covariance else key, f"{problem}; correct it"
        )
    covariance[block] = (covariance[block] + covariance[block].T) / 2
    unknown = np.isnan(value) | np.isnan(np.diag(covariance))
    covariance[unknown, :] = np.nan
    covariance[:, unknown] = np.nan
    for array in (value, covariance):
        array.setflags(write=False)
    return Estimate(
        method=key[1],
        value=value,
        covariance=covariance,
        verdict=Verdict(
            accepted=entry.verdict.accepted,
            reasons=tuple(printable(reason) for reason in entry.verdict.reasons),
            parameters=entry.verdict.parameters,
            disagreement=printable(entry.verdict.disagreement),
        ),
        notes=tuple(printable(note) for note in entry.notes),
        per_mass=_per_mass(document, key, entry),
        geometry=_geometry(document, key, entry.geometry),
    )


def stated_joint(
    document: YamlDocument, key: tuple[str, ...], form: JointForm, loads: tuple[str, ...]
) -> JointCovariance:
    """Joint covariance of several loads, refused where it is none.

    Args:
        document: The file.
        key: Where it stands.
        form: What stands there.
        loads: Their names, in the order of the file.
    """
    matrix = np.array(form.matrix, dtype=np.float64)
    size = 10 * len(loads)
    if form.loads != loads or matrix.shape != (size, size):
        raise document.error(
            key,
            f"expected a matrix of {size} rows over {', '.join(loads)}, found one of shape"
            f" {matrix.shape} over {', '.join(form.loads)}; let identify write the file again",
        )
    known = np.flatnonzero(np.isfinite(np.diag(matrix)))
    labels = [f"{name} {each}" for name in loads for each in BODY_PARAMETERS]
    problem = covariance_problem(matrix[np.ix_(known, known)], [labels[i] for i in known])
    if problem is not None:
        raise document.error((*key, "matrix"), f"{problem}; correct it")
    return JointCovariance(tuple(map(printable, loads)), (matrix + matrix.T) / 2)


def _per_mass(document: YamlDocument, key: tuple[str, ...], entry: EntryForm) -> PerMass | None:
    """Centre of gravity and inertia over mass, where they are there."""
    if entry.inertia_per_mass is None or entry.covariance_per_mass is None:
        return None
    given = entry.covariance_per_mass
    matrix = np.array(given.matrix, dtype=np.float64)
    count = len(PER_MASS_PARAMETERS)
    if given.parameters != PER_MASS_PARAMETERS or matrix.shape != (count, count):
        raise document.error(
            (*key, "covariance_per_mass"),
            f"expected a matrix over {', '.join(PER_MASS_PARAMETERS)}, found one of shape"
            f" {matrix.shape}; let identify write the file again",
        )
    inertia = np.array(entry.inertia_per_mass, dtype=np.float64)
    value = np.concatenate([np.array(entry.center_of_gravity, dtype=np.float64), six(inertia)])
    known = np.flatnonzero(np.isfinite(value) & np.isfinite(np.diag(matrix)))
    block = np.ix_(known, known)
    problem = covariance_problem(matrix[block], [PER_MASS_PARAMETERS[i] for i in known])
    if problem is not None:
        raise document.error((*key, "covariance_per_mass", "matrix"), f"{problem}; correct it")
    return PerMass(value, (matrix + matrix.T) / 2)


def _geometry(
    document: YamlDocument, key: tuple[str, ...], form: GeometryForm | None
) -> FoundGeometry | None:
    """Anchors and attachments as they were found, where they are there."""
    if form is None:
        return None
    counts = [len(each) for of in (form, form.nominal) for each in (of.anchors, of.attachments)]
    if len(set(counts)) > 1:
        raise document.error(
            (*key, "geometry"),
            "expected as many anchors as attachments, found"
            f" {', '.join(str(each) for each in counts)}; let identify write the file again",
        )
    points, nominal = (
        np.array([of.anchors, of.attachments], dtype=np.float64) for of in (form, form.nominal)
    )
    matrix = np.array(form.covariance.matrix, dtype=np.float64)
    found = FoundGeometry(nominal, points, matrix)
    if form.covariance.parameters != found.names() or matrix.shape != (len(found.names()),) * 2:
        raise document.error(
            (*key, "geometry", "covariance"),
            f"expected a matrix over {', '.join(found.names()[:10])}, …, found one of shape"
            f" {matrix.shape}; let identify write the file again",
        )
    problem = covariance_problem(matrix, list(found.names()))
    if problem is not None:
        raise document.error((*key, "geometry", "covariance", "matrix"), f"{problem}; correct it")
    return found


def _ten(document: YamlDocument, key: tuple[str, ...], body: BodyForm) -> Array:
    """The ten of :data:`BODY_PARAMETERS`, NaN for null."""
    inertia = np.array(body.inertia, dtype=np.float64)
    largest = np.max(np.abs(inertia), initial=0.0, where=np.isfinite(inertia))
    if not np.allclose(inertia, inertia.T, rtol=0, atol=ROUNDED * largest, equal_nan=True):
        raise document.error(
            (*key, "inertia"), f"expected a symmetric matrix, found {_rows(inertia)}; correct it"
        )
    return np.array([body.mass, *body.center_of_gravity, *six(inertia)], dtype=np.float64)


def _matrix(document: YamlDocument, key: tuple[str, ...], form: CovarianceForm) -> Array:
    """The numbers of a covariance, NaN for null."""
    if form.parameters != BODY_PARAMETERS:
        raise document.error(
            (*key, "covariance", "parameters"),
            f"expected {', '.join(BODY_PARAMETERS)}, found"
            f" {shortened(', '.join(form.parameters)) or 'none'}; put them in this order",
        )
    key = (*key, "covariance", "matrix")
    lengths = {len(row) for row in form.matrix} or {0}
    if len(form.matrix) != 10 or lengths != {10}:
        raise document.error(
            key,
            f"expected 10 rows of 10, found {len(form.matrix)} of"
            f" {max(lengths - {10}, default=10)}; correct it",
        )
    return np.array(form.matrix, dtype=np.float64)


def _rows(matrix: Array) -> str:
    return str([[None if np.isnan(v) else float(f"{v:.4g}") for v in row] for row in matrix])
