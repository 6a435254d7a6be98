"""What the platform carries in a virtual experiment: the loads of a file, and the bodies that they
really are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from steelyard.errors import InputError
from steelyard.experiment.form import LoadForm
from steelyard.experiment.loads import check_loads, loads_of_forms
from steelyard.experiment.model import Load
from steelyard.files.document import YamlDocument, require_printable
from steelyard.files.file_model import FileModel, validate
from steelyard.files.yaml_file import read_yaml
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.robot.model import Robot

_DENSITY = 7800.0
"""Of a weighed body of which only mass and place are stated [kg/m^3]: a ball of steel."""
_POINTS = BODY_PARAMETERS[:4]
"""What may be known of a body that was added."""


class CarriedForm(FileModel):
    """A file of loads to simulate."""

    loads: dict[str, LoadForm] = Field(min_length=1)
    order: tuple[str, ...] = ()
    """Load of each recording of the same motion, one after the other; without it each load once."""


@dataclass(frozen=True, eq=False)
class Loads:
    """Bodies that the platform is with what it carries."""

    stated: tuple[Load, ...]
    """As the experiment file will say them."""
    order: tuple[str, ...]
    """Names, in the order of the recordings."""

    def drawn(self, rng: np.random.Generator) -> dict[str, Inertia]:
        """What the loads really are: what is known of them lies off by its 1-sigma.

        Args:
            rng: Of what is known with an uncertainty.

        Raises:
            InputError: A body is not stated, or none can be as it is stated.
        """
        bodies: dict[str, Inertia] = {}
        for load in self.stated:
            bodies[load.name] = _body(load, self.stated[0], next(iter(bodies.values()), None), rng)
        return bodies


def stated_bodies(bodies: Mapping[str, Inertia], platform: Inertia | None) -> tuple[Load, ...]:
    """Loads of which an experiment says nothing but their names, and of the first what the robot
    file says.
    """
    return tuple(Load(name, nominal=None if i else platform) for i, name in enumerate(bodies))


def read_loads(path: str | Path, robot: Robot) -> Loads:
    """Read a file of loads.

    Args:
        path: Of a YAML file with ``loads`` as in an experiment file, and ``order``.
        robot: Whose nominal platform is the first load where the file says nothing else.

    Raises:
        InputError: The file is wrong.
    """
    document = read_yaml(Path(path))
    require_printable(document)
    form = validate(CarriedForm, document)
    check_loads(form.loads, document)
    _check_order(form, document)
    for name, each in form.loads.items():
        if not each.rigid:
            raise document.error(
                ("loads", name, "rigid"),
                "expected a rigid body, since nothing moves within the bodies that are simulated,"
                " found false; leave it out",
            )
    loads = Loads(loads_of_forms(form.loads, robot.platform), form.order or tuple(form.loads))
    try:
        loads.drawn(np.random.default_rng(0))
    except InputError as error:
        raise InputError(f"{document.path}: {error}") from None
    return loads


def _check_order(form: CarriedForm, document: YamlDocument) -> None:
    """Refuse an order with other loads than those that are stated."""
    for i, name in enumerate(form.order):
        if name not in form.loads:
            raise document.error(
                ("order", i),
                f"expected the name of a load, found '{name}'; known here: {', '.join(form.loads)}",
            )
    left_out = [name for name in form.loads if form.order and name not in form.order]
    if left_out:
        raise document.error(
            ("order",),
            f"expected every load, found none of '{left_out[0]}'; add it, or leave the load out",
        )


def recordings(order: Iterable[str], motions: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Name of a run -> its load and its motion: every motion with every load of an order."""
    found: dict[str, tuple[str, str]] = {}
    motions = tuple(motions)
    for load in order:
        for motion in motions:
            name, again = f"{motion} {load}", 2
            while name in found:
                name, again = f"{motion} {load} {again}", again + 1
            found[name] = load, motion
    return found


def _body(load: Load, first: Load, without: Inertia | None, rng: np.random.Generator) -> Inertia:
    """What a load really is.

    Args:
        load: As it is stated.
        first: The first of them, to which others are added.
        without: What that really is; None: it is this one.
        rng: Of what is known with an uncertainty.
    """
    if load.added and without is not None:
        body = Inertia.from_parameters(without.parameters + _added(load, first, rng).parameters)
        stated = body.body_parameters
    elif load.nominal is not None:
        stated = load.nominal.body_parameters
    else:
        stated = np.full(len(BODY_PARAMETERS), np.nan)
    values = np.array(stated)
    for name, known in load.known.items():
        values[BODY_PARAMETERS.index(name)] = rng.normal(*known)
    if np.isnan(values).any():
        more = "" if without is None else ", or 'added' to the first load"
        raise InputError(
            f"load '{load.name}': expected the whole body to simulate, found no"
            f" {BODY_PARAMETERS[int(np.isnan(values).argmax())]}; add 'nominal'{more}"
        )
    return _possible(Inertia.from_body_parameters(values), load)


def _added(load: Load, first: Load, rng: np.random.Generator) -> Inertia:
    """What a load has more than the first one: of its nominal body where there is one, else a
    ball.
    """
    if load.nominal is not None and first.nominal is not None:
        more = Inertia.from_parameters(load.nominal.parameters - first.nominal.parameters)
        values = np.array(more.body_parameters)
    else:
        mass = load.added["mass"][0]
        radius = (3 * abs(mass) / (4 * np.pi * _DENSITY)) ** (1 / 3)
        ball = 0.4 * mass * radius**2
        values = np.array([mass, np.nan, np.nan, np.nan, ball, ball, ball, 0, 0, 0])
    for name, known in load.added.items():
        values[_POINTS.index(name)] = rng.normal(*known)
    if np.isnan(values).any():
        raise InputError(
            f"load '{load.name}': expected the place of what was added to simulate it, found no"
            f" {_POINTS[int(np.isnan(values).argmax())]}; add 'center_of_gravity'"
        )
    return Inertia.from_body_parameters(values)


def _possible(body: Inertia, load: Load) -> Inertia:
    """The body, if it can exist."""
    if not body.is_physical:
        raise InputError(
            f"load '{load.name}': expected a body that can exist, found {body!r}; correct what is"
            " stated of it"
        )
    return body
