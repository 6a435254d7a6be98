"""Columns that are components of one vector or rotation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from steelyard.drafts.words import ANGLES, COMMANDS, NEUTRAL, QUANTITIES, Name, quantity_of

AXES = ("x", "y", "z")
CONTRACT = {
    "angular_velocity": "w",
    "specific_force": "a",
    "force": "f",
    "torque": "t",
    "position": "",
    "orientation": "q",
}
"""Vector -> what stands before the axis in the columns of the contract."""
GRAVITY_OR_GYRO = "that gx, gy, gz are rates of a gyro and not the gravity"


@dataclass(frozen=True)
class VectorColumns:
    """Columns of one vector or rotation."""

    quantity: str
    columns: Mapping[str, Name]
    label: tuple[str, ...]
    commanded: bool
    checks: tuple[str, ...] = ()


def groups_among(
    names: Sequence[Name], hints: Sequence[str], commanded: bool
) -> Iterable[VectorColumns]:
    """Complete vectors and rotations."""
    members: dict[tuple[str, tuple[str, ...]], dict[str, Name]] = {}
    for name in names:
        place, sort = _component(name)
        if place is not None:
            word = ANGLES.get(name.words[place], name.words[place])
            members.setdefault((sort, name.template(place)), {})[word] = name
        elif len(name.words) == 1 and name.words[0] in {"p", "q", "r"}:
            members.setdefault(("rates", ("omega", "@")), {})["xyz"["pqr".index(name.words[0])]] = (
                name
            )
    forces = {
        label_of(t)
        for (_, t), its in members.items()
        if set(AXES) <= set(its) and quantity_of(t) == "force"
    }
    for (_, template), its in members.items():
        group = _group(template, its, hints, forces)
        if group is not None:
            yield replace(group, commanded=commanded or bool(COMMANDS.intersection(template)))
    matrix = _matrix(names)
    if matrix is not None:
        yield replace(matrix, commanded=commanded)


def _component(name: Name) -> tuple[int | None, str]:
    """Where the component of a vector or rotation stands, and of what sort it is."""
    if name.angle is not None:
        return name.angle, "angle"
    if name.axis is not None:
        return name.axis, "axis"
    return (name.numbers[-1], "number") if name.numbers else (None, "")


def _group(
    template: tuple[str, ...],
    its: Mapping[str, Name],
    hints: Sequence[str],
    forces: set[tuple[str, ...]],
) -> VectorColumns | None:
    """The vector or rotation that components of one template are; None: they are none."""
    keys, label = set(its), label_of(template)
    if keys >= {"roll", "pitch", "yaw"}:
        if quantity_of(template) is None:
            return None
        if _says_rate(template):
            named = dict(
                zip(("wx", "wy", "wz"), (its["roll"], its["pitch"], its["yaw"]), strict=True)
            )
            return VectorColumns(
                "angular_velocity",
                named,
                label,
                False,
                ("that the rates are those about the axes of the body",),
            )
        return VectorColumns(
            "orientation", {k: its[k] for k in ("roll", "pitch", "yaw")}, label, False
        )
    quantity = quantity_of(template)
    if quantity is None:
        return None
    if keys >= {"w", "x", "y", "z"} and quantity in {"orientation", ""}:
        return VectorColumns(
            "orientation", {f"q{axis}": its[axis] for axis in "wxyz"}, label, False
        )
    for digits in (("0", "1", "2", "3"), ("1", "2", "3", "4")):
        if quantity == "orientation" and keys == set(digits):
            named = dict(zip(("qw", "qx", "qy", "qz"), (its[d] for d in digits), strict=True))
            return VectorColumns(
                "orientation",
                named,
                label,
                False,
                ("that the scalar part of the quaternion comes first",),
            )
    axes = next((a for a in (AXES, ("0", "1", "2"), ("1", "2", "3")) if keys >= set(a)), None)
    if axes is None or (axes != AXES and (len(keys) != 3 or not quantity)):
        return None
    if template == ("g", "@"):
        return VectorColumns(
            "angular_velocity", _xyz("w", its, axes), (), False, (GRAVITY_OR_GYRO,)
        )
    if not quantity:
        quantity = (hinted(hints) if template == ("@",) else None) or "position"
    if quantity == "torque" and template[:-1][-1:] == ("t",) and label not in forces:
        quantity = "position"
    if quantity == "orientation":
        named = dict(zip(("roll", "pitch", "yaw"), (its[a] for a in axes), strict=True))
        return VectorColumns(
            quantity,
            named,
            label,
            False,
            ("that these are roll, pitch and yaw, R = Rz(yaw) Ry(pitch) Rx(roll)",),
        )
    return VectorColumns(quantity, _xyz(CONTRACT[quantity], its, axes), label, False)


def _xyz(letter: str, its: Mapping[str, Name], axes: Sequence[str]) -> dict[str, Name]:
    return {letter + axis: its[a] for axis, a in zip(AXES, axes, strict=True)}


def _says_rate(template: tuple[str, ...]) -> bool:
    return bool({"rate", "rates", "velocity", "vel", "speed", "gyro"}.intersection(template))


def hinted(hints: Sequence[str]) -> str | None:
    """Quantity that topic, file or folder speak of, where a column is nothing but x."""
    found = {quantity_of((word,)) for word in hints if len(word) > 1}
    named = [
        q
        for q in ("angular_velocity", "specific_force", "torque", "force", "position")
        if q in found
    ]
    return named[0] if named else None


def _matrix(names: Sequence[Name]) -> VectorColumns | None:
    """Nine columns of a rotation matrix, row by row."""
    found: dict[str, Name] = {}
    listed: dict[tuple[str, ...], dict[int, Name]] = {}
    for name in names:
        words = name.words
        if (
            len(words) >= 2
            and words[-2] in {"r", "rot", "dcm", "m", "matrix"}
            and len(words[-1]) == 2
        ):
            found[words[-1]] = name
        elif (
            len(words) >= 3
            and words[-3] in {"r", "rot", "dcm", "matrix"}
            and len(words[-2]) == len(words[-1]) == 1
        ):
            found[words[-2] + words[-1]] = name
        elif (
            len(words) >= 2
            and words[-2] in {"rotation", "rot", "dcm", "matrix"}
            and words[-1].isdigit()
        ):
            listed.setdefault(words[:-1], {})[int(words[-1])] = name
    for first in "10":
        cells = [f"{int(first) + i}{int(first) + j}" for i in range(3) for j in range(3)]
        if all(cell in found for cell in cells):
            named = {
                f"r{i + 1}{j + 1}": found[cells[3 * i + j]] for i in range(3) for j in range(3)
            }
            return VectorColumns("orientation", named, label_of(found[cells[0]].words[:-2]), False)
    for words, its in listed.items():
        if sorted(its) == list(range(9)):
            named = {f"r{i + 1}{j + 1}": its[3 * i + j] for i in range(3) for j in range(3)}
            return VectorColumns(
                "orientation", named, label_of(words), False, ("that the matrix stands row by row",)
            )
    return None


def label_of(words: Iterable[str]) -> tuple[str, ...]:
    """Words of a name that say neither what is read nor which component: whose it is."""
    known = frozenset().union(
        *QUANTITIES.values(),
        NEUTRAL,
        COMMANDS,
        ANGLES,
        {"@", "angular", "velocity", "rate", "vel", "receive"},
    )
    return tuple(word for word in words if word not in known)
