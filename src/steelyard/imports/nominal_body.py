"""The nominal body of a robot file: which sign products of inertia have, about which point an
inertia is, and what physics says of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from steelyard.errors import InputError
from steelyard.imports.description import Convention, DescribedBody, Point
from steelyard.inertia import Inertia, point_inertia, symmetric

_OTHER: dict[Convention, Convention] = {"matrix": "integral", "integral": "matrix"}
_MEANING: dict[Convention, str] = {
    "matrix": "elements of the inertia matrix, as in a robot file",
    "integral": "+integral(x y dm), whose signs are turned in the robot file",
}
_POINTS: dict[Point, str] = {
    "cog": "the centre of gravity",
    "origin": "the origin of the platform frame",
}


@dataclass(frozen=True, eq=False)
class NominalBody:
    """A body as a robot file has it."""

    inertia: Inertia
    convention: Convention | None
    """What the products of inertia of the files were taken for; None: they are zero."""
    notes: tuple[str, ...]
    """What was taken for what, and whether such a body can exist."""


def nominal_body(
    body: DescribedBody, *, products: Convention | None, about: Point | None
) -> NominalBody:
    """Decide what a description of a body means.

    Args:
        body: As it stands in the files.
        products: What the products of inertia are, above what the format says.
        about: About which point the inertia is, where the format does not say.

    Raises:
        InputError: The sign of the products must be said, or what was said contradicts the files.
    """
    if about is not None and body.about is not None:
        raise InputError(
            "--inertia-about: expected none, as the files say about which point the inertia is,"
            f" found '{about}'; leave it out"
        )
    point = about or body.about or "cog"
    notes = []
    if body.about is None and any(body.center_of_gravity):
        reason = "which is assumed: the file does not say (--inertia-about)"
        if about:
            reason = "as --inertia-about says"
        notes.append(f"inertia is about {_POINTS[point]}, {reason}")
    if not any(body.products):
        inertia = _inertia(body, "matrix", point)
        return NominalBody(inertia, None, (*notes, *_impossible(inertia)))
    convention = products or body.convention
    products_by_name = zip(("yz", "xz", "xy"), body.products, strict=True)
    named = ", ".join(f"{name} {value:g}" for name, value in products_by_name)
    if convention is None:
        raise InputError(
            f"{body.where}: expected products of inertia whose sign is known, found {named}, and"
            f" {body.reason}; say with --products matrix that they are elements of the inertia"
            " matrix, or with --products integral that they are +integral(x y dm)"
        )
    reason = "as --products says" if products else body.reason
    notes.append(f"products of inertia {named} are read as {_MEANING[convention]}: {reason}")
    inertia, turned = (_inertia(body, each, point) for each in (convention, _OTHER[convention]))
    return NominalBody(
        inertia, convention, (*notes, *_impossible(inertia), _sign(inertia, turned, convention))
    )


def _inertia(body: DescribedBody, convention: Convention, point: Point) -> Inertia:
    sign = -1.0 if convention == "integral" else 1.0
    J = symmetric([*body.moments, *(sign * value for value in body.products)])
    if point == "origin":
        J = J - point_inertia(body.mass, body.center_of_gravity)
    return Inertia(body.mass, np.array(body.center_of_gravity), J)


def _impossible(body: Inertia) -> Iterator[str]:
    """Note of a body that cannot exist."""
    if body.is_physical:
        return
    moments = ", ".join(f"{v:g}" for v in body.principal_moments)
    yield (
        f"no solid body has this inertia: its principal moments are {moments} kg m^2, each must"
        " be above 0 and below the sum of the others"
    )


def _sign(body: Inertia, turned: Inertia, convention: Convention) -> str:
    """What the condition that a body exists says of the sign of the products."""
    if body.is_physical and turned.is_physical:
        return "physics cannot decide the sign of the products: with either a body can exist"
    if body.is_physical:
        return "the sign of the products is that of a body: with the other sign none can exist"
    if turned.is_physical:
        return (
            f"with products of the other sign (--products {_OTHER[convention]}) a body can exist:"
            " that is likely what is meant"
        )
    return "nor can one with products of the other sign"
