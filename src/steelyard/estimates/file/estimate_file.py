"""Estimates read back from what `identify` writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from steelyard.display import printable
from steelyard.errors import InputError
from steelyard.estimates.file.form import LoadsForm, read_form
from steelyard.estimates.file.stated import stated_estimate, stated_joint, stated_nominal
from steelyard.estimates.named_estimate import FILE_NAME, NamedEstimate
from steelyard.files.document import YamlDocument
from steelyard.inertia import Inertia
from steelyard.output import settle

ALL = "all"
"""Stands for every method of a file."""


@dataclass(frozen=True, eq=False)
class EstimateFile:
    """What an estimate file holds."""

    path: Path
    experiment: str
    nominal: Inertia | None
    result: str
    """Name of the best method."""
    estimates: Mapping[str, NamedEstimate]
    """By the name of their method; without calibration, residuals and single runs."""
    loads: Mapping[str, Mapping[str, NamedEstimate]] = field(default_factory=dict)
    """The same of every load, by method and load, where there are several."""

    def chosen(
        self, method: str | None = None, load: str | None = None
    ) -> tuple[NamedEstimate, ...]:
        """The estimate of a method.

        Args:
            method: Its name; None: the result; ``all``: every one.
            load: Name of a load; None: the first, or there is one.

        Raises:
            InputError: There is none of that name.
        """
        if load is not None:
            return tuple(self._of_load(each.estimate.method, load) for each in self.chosen(method))
        if method == ALL:
            return tuple(self.estimates.values())
        if method is not None and method not in self.estimates:
            raise InputError(
                f"{self.path}: expected an estimate of method '{method}', found"
                f" {', '.join(self.estimates)}; choose one of these"
            )
        return (self.estimates[method or self.result],)

    def _of_load(self, method: str, load: str) -> NamedEstimate:
        """The estimate of a load by a method."""
        loads = self.loads.get(method, {})
        if load not in loads:
            found = ", ".join(loads) or "an estimate of one body"
            raise InputError(
                f"{self.path}: expected a load '{load}' under {method}, found {found}; choose one"
                " of its loads, or leave '#' out"
            )
        return loads[load]


def read_estimate_file(path: Path) -> EstimateFile:
    """Read what `identify` wrote.

    Args:
        path: An estimate file, or a folder with one.

    Raises:
        InputError: It is not there, too large, no JSON, or not of the form of the contract.
    """
    path = path / FILE_NAME if path.is_dir() else path
    # Of a process that was killed while it replaced results.
    settle(path.parent)
    document, form = read_form(path)
    if form.result not in form.estimates:
        raise document.error(
            ("result",),
            "expected the name of one of the estimates"
            f" ({', '.join(form.estimates) or 'there is none'}), found '{form.result}'; let"
            " identify write the file again",
        )
    source, experiment = str(path.resolve()), printable(form.experiment)
    estimates = {
        name: NamedEstimate(
            name,
            stated_estimate(document, ("estimates", name), entry),
            experiment,
            source,
            entry.covariance is not None,
            recordings=frozenset((form.recordings or {}).values()),
        )
        for name, entry in ((printable(name), entry) for name, entry in form.estimates.items())
    }
    loads = {
        printable(name): _loads(document, name, entry, estimates[printable(name)])
        for name, entry in form.estimates.items()
        if entry.loads
    }
    nominal = stated_nominal(document, form.nominal)
    return EstimateFile(path, experiment, nominal, printable(form.result), estimates, loads)


def _loads(
    document: YamlDocument, method: str, entry: LoadsForm, first: NamedEstimate
) -> dict[str, NamedEstimate]:
    """Estimates of all loads by a method, with what they share."""
    key = ("estimates", method)
    joint = (
        None
        if entry.joint is None
        else stated_joint(document, (*key, "joint"), entry.joint, tuple(entry.loads or ()))
    )
    return {
        printable(name): replace(
            first,
            estimate=replace(
                stated_estimate(document, (*key, "loads", name), each), method=first.estimate.method
            ),
            load=printable(name),
            joint=joint,
        )
        for name, each in (entry.loads or {}).items()
    }
