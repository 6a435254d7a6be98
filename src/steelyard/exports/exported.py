"""What an export is made of, and when it is refused."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, judge
from steelyard.estimates.file.estimate_file import ALL
from steelyard.estimates.file.places import read_estimates
from steelyard.estimates.named_estimate import NamedEstimate
from steelyard.inertia import BODY_PARAMETERS, Inertia

_LINK = re.compile(r"[A-Za-z_][\w\-/]{0,99}", re.ASCII)
"""Names that every format takes."""


@dataclass(frozen=True, eq=False)
class Exported:
    """An estimate with where it comes from."""

    estimate: Estimate
    experiment: str = ""
    """Name of the experiment; empty: not known."""
    path: Path | None = None
    """Of the file that holds the estimate; None: it is in memory only."""
    digest: str = ""
    """Beginning of the SHA-256 of that file."""
    correlated: bool = True
    """Whether the covariance is known, and not the 1-sigmas alone."""
    version: str = field(default_factory=lambda: version("steelyard"))
    """Of steelyard."""
    link: str = "platform"
    """Name of the body, in formats that have names."""

    def __post_init__(self) -> None:
        if not _LINK.fullmatch(self.link):
            raise InputError(
                "--link: expected a name of letters, digits, '_', '-' and '/', found"
                f" '{self.link}'; choose another"
            )

    @property
    def source(self) -> str:
        """Name of the file, without the folder, which says nothing elsewhere; empty where there is
        none.
        """
        return self.path.name if self.path else ""

    @property
    def where(self) -> str:
        """For messages."""
        place = f"{self.path}: " if self.path else ""
        return f"{place}estimate '{self.estimate.method}'"

    @property
    def body(self) -> Inertia:
        """The body.

        Raises:
            InputError: Not all ten of its parameters are known.
        """
        body = self.estimate.body
        if body is None:
            raise InputError(
                f"{self.where}: expected all ten parameters of a body, found none for"
                f" {', '.join(self.unidentifiable)}; choose another method, or record more motion"
            )
        return body

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Of :data:`steelyard.inertia.BODY_PARAMETERS` those without a number."""
        variance = np.diag(self.estimate.covariance)
        known = np.isfinite(self.estimate.value) & np.isfinite(variance)
        return tuple(np.array(BODY_PARAMETERS)[~known].tolist())

    @property
    def impossible(self) -> tuple[str, ...]:
        """Why no body has these numbers; empty: one can, or too little is known of it."""
        return judge(self.estimate.value).reasons if self.estimate.physical is False else ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the estimate is not to be relied on; empty: it is accepted, and a body that can
        exist.
        """
        verdict = self.estimate.verdict
        # A file may say that it is not accepted, and not why.
        reasons = () if verdict.accepted else verdict.reasons or ("its verdict gives no reason",)
        return tuple(dict.fromkeys((*reasons, *self.impossible)))

    @property
    def linear_parameters(self) -> Array:
        """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, NaN where a number that they need
        is not known, shape (10,).
        """
        m, x, y, z, *inertia = self.estimate.value
        squares = (y * y + z * z, x * x + z * z, x * x + y * y)
        products = (-y * z, -x * z, -x * y)
        shifted = np.array(inertia) + m * np.array([*squares, *products])
        return np.array([m, m * x, m * y, m * z, *shifted])


def read_exported(place: str, method: str | None = None) -> Exported:
    """Read the estimate that is to be exported.

    Args:
        place: An estimate file, or a folder with one, with ``:METHOD`` behind it where not its
            result is meant.
        method: The same for a place without.

    Raises:
        InputError: It cannot be read, or it is not one estimate.
    """
    found = read_estimates([place], method)
    if len(found) > 1 or method == ALL:
        names = ", ".join(each.estimate.method for each in found)
        raise InputError(
            f"{place}: expected one estimate to export, found '{ALL}' ({names}); name one with"
            " --method"
        )
    return exported_of(found[0])


def exported_of(named: NamedEstimate) -> Exported:
    """An estimate that has been read, with the file that it was read from."""
    path = Path(named.source)
    return Exported(
        estimate=named.estimate,
        experiment=named.experiment,
        path=path,
        digest=sha256(path.read_bytes()).hexdigest()[:16],
        correlated=named.correlated,
    )


def check(exported: Exported, *, title: str, whole: bool, anyway: bool) -> None:
    """Refuse what a simulator or controller should not be given.

    Args:
        exported: The estimate.
        title: Of the format.
        whole: Whether the format has no place for numbers that are not known.
        anyway: Whether the user wants it all the same.

    Raises:
        InputError: The estimate is not a body or not accepted, and ``anyway`` is not given or does
            not help.
    """
    unidentifiable = exported.unidentifiable
    if unidentifiable and (whole or not anyway):
        help_ = (
            f"--anyway does not help, {title} has no place for what is not known"
            if whole
            else "or null in their place with --anyway"
        )
        raise InputError(
            f"{exported.where}: expected all ten parameters of a body, found that the data do not"
            f" tell {', '.join(unidentifiable)}; choose another method or record more motion"
            f" ('steelyard design' finds it); {help_}"
        )
    if exported.doubts and not anyway:
        baseline = exported.estimate.verdict.accepted is None
        found = "a baseline that was not assessed" if baseline else "one that is not"
        raise InputError(
            f"{exported.where}: expected an accepted estimate of a body that can exist, found"
            f" {found} ({'; '.join(exported.doubts)}); correct what is named there, choose"
            " another method, or export it all the same with --anyway"
        )
