"""Bodies that runs carry, as files state them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from steelyard.experiment.form import AddedBodyForm, KnownBodyForm, LoadForm
from steelyard.experiment.model import Load
from steelyard.files.document import YamlDocument
from steelyard.inertia import Inertia
from steelyard.robot.file import PlatformForm, body_of_form

_NAME = re.compile(r"\w[\w \-]*")
"""Names of loads: they stand behind '#' and in names of differences."""
NO_WALK = "expected one body in all runs, found 'loads'; leave out one of the two"
"""Where a mass walks and there are several."""


def loads_of_forms(forms: Mapping[str, LoadForm], platform: Inertia | None) -> tuple[Load, ...]:
    """The loads that a file states.

    Args:
        forms: Name -> what is stated of it.
        platform: Of the robot file: the first load where nothing else is said of it.
    """
    loads = tuple(
        Load(
            name,
            known_values(each.known),
            body_of_form(each.nominal),
            each.rigid,
            _known_points(each.added),
        )
        for name, each in forms.items()
    )
    if not loads:
        return ()
    return (replace(loads[0], nominal=loads[0].nominal or platform), *loads[1:])


def known_values(form: KnownBodyForm) -> dict[str, tuple[float, float]]:
    """Body parameter -> value and 1-sigma known beforehand."""
    entries = {f"J{axes}": entry for axes, entry in vars(form.inertia).items()}
    known = {name: (entry.value, entry.sigma) for name, entry in entries.items() if entry}
    return _known_points(form) | known


def _known_points(form: KnownBodyForm | AddedBodyForm) -> dict[str, tuple[float, float]]:
    """The same of mass and centre of gravity."""
    entries = {
        "mass": form.mass,
        **{f"c{axis}": entry for axis, entry in vars(form.center_of_gravity).items()},
    }
    return {
        name: (entry.value, entry.sigma)
        for name, entry in entries.items()
        if entry and entry.value is not None
    }


def mass_walk(form: KnownBodyForm) -> float:
    """Density of the random walk of the mass [kg/sqrt(s)]."""
    return form.mass.walk if form.mass else 0.0


def check_loads(forms: Mapping[str, LoadForm], document: YamlDocument) -> None:
    """Refuse names and bodies that cannot be, whatever the runs are.

    Raises:
        InputError: There is one.
    """
    for name, each in forms.items():
        if mass_walk(each.known):
            raise document.error(("loads", name, "known", "mass", "walk"), NO_WALK)
        if not _NAME.fullmatch(name):
            raise document.error(
                ("loads", name),
                "expected a name of letters, digits, '_', '-' and blanks, found"
                f" '{name}'; rename it",
            )
        if each.nominal is not None and not _is_possible(each.nominal):
            raise document.error(
                ("loads", name, "nominal"),
                "expected a body that can exist, found one whose moments of inertia no body has;"
                " correct it",
            )
    for i, (name, each) in enumerate(forms.items()):
        _check_added(name, each, document, is_first=i == 0)


def _check_added(name: str, form: LoadForm, document: YamlDocument, *, is_first: bool) -> None:
    """Refuse what the first load has more than itself, and a place of what nobody has weighed."""
    added = _known_points(form.added)
    if added and is_first:
        raise document.error(
            ("loads", name, "added"),
            "expected none of the first load, to which others are added, found one; put the load"
            " without it first",
        )
    if added and "mass" not in added:
        raise document.error(
            ("loads", name, "added"),
            "expected the mass of what was added beside its centre of gravity, found none; add it",
        )


def _is_possible(form: PlatformForm) -> bool:
    """Whether a body can exist."""
    try:
        body = body_of_form(form)
    except ValueError:
        return False
    return body is None or body.is_physical
