"""cdpyr (github.com/cable-robots/cdpyr): JSON or YAML of its ``Robot``, by the names of its schema,
SI units.

``analysis/kinematics/pulley.py``: the roller swivels about the z axis of the frame ``anchor.dcm
pulley.dcm`` through the position of the anchor; its centre lies ``radius`` from there, square to
that axis, towards the platform. The cable leaves, after the wrap angle b, at ``r (-cos b, sin b)``
from the centre in the direction ``(sin b, cos b)``, components outward and along z: as in a robot
file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from steelyard.arrays import Array
from steelyard.files.document import YamlDocument
from steelyard.files.file_model import validate
from steelyard.imports.description import Cable, DescribedBody, Description, Vector
from steelyard.imports.sources import ForeignModel, Matrix, Source, only_document, unread
from steelyard.rotations import is_rotation

NAME = "cdpyr"

_ORTHONORMAL = 1e-6
"""How far a matrix may be from a rotation: rounding of decimal numbers."""
_SYMMETRIC = 1e-6
"""How far an inertia matrix may be from a symmetric one, as a part of its largest element."""
_SIGN_UNKNOWN = (
    "cdpyr makes no use of them, and its own model of CoGiRo has the signs of the data sheet,"
    " +integral(x y dm)"
)


def _number(value: Any) -> Any:
    """What JSON of Python says for the numbers that JSON lacks."""
    words = {"Infinity": math.inf, "-Infinity": -math.inf, "NaN": math.nan}
    return words.get(value, value) if isinstance(value, str) else value


Extended = Annotated[float, Field(allow_inf_nan=True), BeforeValidator(_number)]
ExtendedMatrix = tuple[
    tuple[Extended, Extended, Extended],
    tuple[Extended, Extended, Extended],
    tuple[Extended, Extended, Extended],
]
_IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class CdpyrPulleyForm(ForeignModel):
    """Roller."""

    radius: Annotated[float, Field(ge=0)]
    dcm: Matrix | None = None


class AnchorForm(ForeignModel):
    """Point of the frame."""

    position: Vector
    dcm: Matrix | None = None
    pulley: CdpyrPulleyForm | None = None


class CdpyrFrameForm(ForeignModel):
    """What does not move."""

    anchors: tuple[AnchorForm, ...]


class AttachmentForm(ForeignModel):
    """Point of the platform; turning it means nothing."""

    position: Vector
    dcm: object = None


class PatternForm(ForeignModel):
    """In how many ways the platform can move."""

    translation: int
    rotation: int


class InertiaForm(ForeignModel):
    """Masses and inertia; infinite where they were not given."""

    linear: ExtendedMatrix | None = None
    angular: ExtendedMatrix | None = None


class CdpyrPlatformForm(ForeignModel):
    """Body."""

    anchors: tuple[AttachmentForm, ...]
    motion_pattern: PatternForm
    center_of_gravity: Vector = (0.0, 0.0, 0.0)
    inertia: InertiaForm | None = None


class CdpyrCableForm(ForeignModel):
    """What a cable is made of."""

    diameter: Annotated[float, Field(ge=0)] | None = None


class ChainForm(ForeignModel):
    """Which cable goes from where to where."""

    frame_anchor: Annotated[int, Field(ge=0)]
    platform: Annotated[int, Field(ge=0)] = 0
    platform_anchor: Annotated[int, Field(ge=0)]
    cable: Annotated[int, Field(ge=0)]


class CdpyrRobotForm(ForeignModel):
    """The whole file."""

    name: str | None = None
    frame: CdpyrFrameForm
    platforms: tuple[CdpyrPlatformForm, ...]
    cables: tuple[CdpyrCableForm, ...] = ()
    kinematic_chains: tuple[ChainForm, ...]


def recognises(source: Source) -> bool:
    """Whether a file has the parts of a robot of cdpyr."""
    return (
        isinstance(source, YamlDocument)
        and isinstance(source.data, dict)
        and {"frame", "platforms", "kinematic_chains"} <= source.data.keys()
    )


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The robot of a file.

    Args:
        sources: One file.
        cable_set: None: there are no sets.

    Raises:
        InputError: The file is wrong, or there are several, or it has more than one platform.
    """
    document = only_document(sources, NAME)
    form = validate(CdpyrRobotForm, document)
    if len(form.platforms) != 1:
        raise document.error(
            ("platforms",),
            f"expected one platform, found {len(form.platforms)}; a robot file describes one, so"
            " this robot cannot become one",
        )
    pattern = form.platforms[0].motion_pattern
    if pattern.translation != 3:
        raise document.error(
            ("platforms", 0, "motion_pattern", "translation"),
            "expected a platform that cables alone hold, which moves in 3 directions, found"
            f" {pattern.translation}; a robot file knows no guides",
        )
    body = _body(form.platforms[0], document)
    return Description(
        format=NAME,
        files=(document.path,),
        name=form.name or "",
        cables=tuple(_cable(form, i, document) for i in range(len(form.kinematic_chains))),
        body=body if isinstance(body, DescribedBody) else None,
        notes=(*_notes(body, pattern.rotation), *unread(form)),
    )


def _cable(form: CdpyrRobotForm, i: int, document: YamlDocument) -> Cable:
    """A cable by the indices of its chain."""
    chain = form.kinematic_chains[i]
    platform = form.platforms[0]
    for name, index, among in (
        ("frame_anchor", chain.frame_anchor, len(form.frame.anchors)),
        ("platform", chain.platform, len(form.platforms)),
        ("platform_anchor", chain.platform_anchor, len(platform.anchors)),
        ("cable", chain.cable, len(form.cables)),
    ):
        if index >= among:
            raise document.error(
                ("kinematic_chains", i, name),
                f"expected one of the {among} that there are, counted from 0, found {index};"
                " correct it",
            )
    anchor = form.frame.anchors[chain.frame_anchor]
    radius, axis = 0.0, (0.0, 0.0, 1.0)
    if anchor.pulley is not None and anchor.pulley.radius:
        key = ("frame", "anchors", chain.frame_anchor)
        R = _rotation(anchor.dcm, document, (*key, "dcm")) @ _rotation(
            anchor.pulley.dcm, document, (*key, "pulley", "dcm")
        )
        x, y, z = (round(float(v), 12) + 0.0 for v in R[:, 2])
        radius, axis = anchor.pulley.radius, (x, y, z)
    return Cable(
        where=document.where(("kinematic_chains", i)),
        anchor=anchor.position,
        attachment=platform.anchors[chain.platform_anchor].position,
        radius=radius,
        axis=axis,
        diameter=form.cables[chain.cable].diameter or None,
    )


def _rotation(dcm: Matrix | None, document: YamlDocument, key: tuple[str | int, ...]) -> Array:
    """A direction cosine matrix of the file, which has to be a rotation."""
    R = np.array(dcm or _IDENTITY)
    if not is_rotation(R, _ORTHONORMAL):
        raise document.error(key, "expected a rotation matrix, found another; correct it")
    return R


def _body(platform: CdpyrPlatformForm, document: YamlDocument) -> DescribedBody | str:
    """The body, or why there is none."""
    inertia = platform.inertia
    where: tuple[str | int, ...] = ("platforms", 0, "inertia")
    if inertia is None or inertia.linear is None or inertia.angular is None:
        return "the file has no inertia of it"
    M, J = np.array(inertia.linear), np.array(inertia.angular)
    if not (np.isfinite(M).all() and np.isfinite(J).all()):
        return "its inertia is infinite, which is how cdpyr says that it was not given"
    mass = float(M[0, 0])
    if mass <= 0 or np.abs(M - mass * np.eye(3)).max() > _SYMMETRIC * mass:
        raise document.error(
            (*where, "linear"),
            f"expected one mass above 0 on the diagonal, found {M.tolist()}; correct it",
        )
    if np.abs(J - J.T).max() > _SYMMETRIC * np.abs(J).max():
        raise document.error(
            (*where, "angular"), f"expected a symmetric matrix, found {J.tolist()}; correct it"
        )
    return DescribedBody(
        where=document.where(where),
        mass=mass,
        center_of_gravity=platform.center_of_gravity,
        moments=(float(J[0, 0]), float(J[1, 1]), float(J[2, 2])),
        products=(float(J[1, 2]), float(J[0, 2]), float(J[0, 1])),
        convention=None,
        reason=_SIGN_UNKNOWN,
        about=None,
    )


def _notes(body: DescribedBody | str, rotations: int) -> Iterator[str]:
    """Why there is no body, and that the platform turns in more ways than in the file."""
    if isinstance(body, str):
        yield f"no platform: {body}"
    if rotations != 3:
        yield f"cdpyr lets the platform turn in {rotations} ways, a robot file in all 3"
