"""Columns that are components of one vector or rotation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from steelyard.drafts.words import ANGLES, COMMANDS, NEUTRAL, QUANTITIES, Name, quantity_of

AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")
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
    label: tuple[str, ...] = ()
    """Words that say whose it is."""
    checks: tuple[str, ...] = ()
    """What a person should look at."""
    commanded: bool = False
    """Whether it is a set point."""


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
            axis = AXES["pqr".index(name.words[0])]
            members.setdefault(("rates", ("omega", "@")), {})[axis] = name
    whole = [template for (_, template), its in members.items() if set(AXES) <= its.keys()]
    forces = {label_of(template) for template in whole if quantity_of(template) == "force"}
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
    """The vector or rotation that components of one template are; None: they are none.

    Args:
        template: Words that their names share.
        its: Component -> name.
        hints: Words of topic and file.
        forces: Labels of forces, beside which a ``t`` is a torque.
    """
    quantity = quantity_of(template)
    if quantity is None:
        return None
    if its.keys() >= set(_ANGLES):
        return _of_angles(template, its)
    return _quaternion(template, its, quantity) or _vector(template, its, quantity, hints, forces)


def _of_angles(template: tuple[str, ...], its: Mapping[str, Name]) -> VectorColumns:
    """Roll, pitch, yaw, or their rates."""
    label = label_of(template)
    if not _says_rate(template):
        return VectorColumns("orientation", {angle: its[angle] for angle in _ANGLES}, label)
    rates = {f"w{axis}": its[angle] for axis, angle in zip(AXES, _ANGLES, strict=True)}
    check = "that the rates are those about the axes of the body"
    return VectorColumns("angular_velocity", rates, label, (check,))


def _quaternion(
    template: tuple[str, ...], its: Mapping[str, Name], quantity: str
) -> VectorColumns | None:
    """Four components by letters or numbers; None: they are no quaternion."""
    label = label_of(template)
    if its.keys() >= set("wxyz") and quantity in {"orientation", ""}:
        return VectorColumns("orientation", {f"q{axis}": its[axis] for axis in "wxyz"}, label)
    for digits in ("0123", "1234"):
        if quantity == "orientation" and its.keys() == set(digits):
            named = {f"q{axis}": its[d] for axis, d in zip("wxyz", digits, strict=True)}
            check = "that the scalar part of the quaternion comes first"
            return VectorColumns("orientation", named, label, (check,))
    return None


def _vector(
    template: tuple[str, ...],
    its: Mapping[str, Name],
    quantity: str,
    hints: Sequence[str],
    forces: set[tuple[str, ...]],
) -> VectorColumns | None:
    """Three components by letters or numbers; None: they are no vector."""
    label = label_of(template)
    axes = next((axes for axes in ("xyz", "012", "123") if its.keys() >= set(axes)), None)
    if axes is None or (axes != "xyz" and (len(its) != 3 or not quantity)):
        return None
    if template == ("g", "@"):
        return VectorColumns("angular_velocity", _xyz("w", its, axes), checks=(GRAVITY_OR_GYRO,))
    if not quantity:
        quantity = (hinted(hints) if template == ("@",) else None) or "position"
    if quantity == "torque" and template[:-1][-1:] == ("t",) and label not in forces:
        quantity = "position"
    if quantity == "orientation":
        named = {angle: its[a] for angle, a in zip(_ANGLES, axes, strict=True)}
        check = "that these are roll, pitch and yaw, R = Rz(yaw) Ry(pitch) Rx(roll)"
        return VectorColumns(quantity, named, label, (check,))
    return VectorColumns(quantity, _xyz(CONTRACT[quantity], its, axes), label)


def _xyz(letter: str, its: Mapping[str, Name], axes: Sequence[str]) -> dict[str, Name]:
    return {letter + axis: its[a] for axis, a in zip(AXES, axes, strict=True)}


def _says_rate(template: tuple[str, ...]) -> bool:
    return bool({"rate", "rates", "velocity", "vel", "speed", "gyro"}.intersection(template))


def hinted(hints: Sequence[str]) -> str | None:
    """Quantity that topic, file or folder speak of, where a column is nothing but x."""
    found = {quantity_of((word,)) for word in hints if len(word) > 1}
    ordered = ("angular_velocity", "specific_force", "torque", "force", "position")
    return next((quantity for quantity in ordered if quantity in found), None)


def _matrix(names: Sequence[Name]) -> VectorColumns | None:
    """Nine columns of a rotation matrix, row by row."""
    found: dict[str, Name] = {}
    listed: dict[tuple[str, ...], dict[int, Name]] = {}
    for name in names:
        first, middle, last = ("", "", "", *name.words)[-3:]
        if middle in {"r", "rot", "dcm", "m", "matrix"} and len(last) == 2:
            found[last] = name
        elif first in {"r", "rot", "dcm", "matrix"} and len(middle) == len(last) == 1:
            found[middle + last] = name
        elif middle in {"rotation", "rot", "dcm", "matrix"} and last.isdigit():
            listed.setdefault(name.words[:-1], {})[int(last)] = name
    for numbers in ("123", "012"):
        cells = [row + column for row in numbers for column in numbers]
        if found.keys() >= set(cells):
            own = [found[cell] for cell in cells]
            return VectorColumns("orientation", _rows(own), label_of(own[0].words[:-2]))
    for words, its in listed.items():
        if sorted(its) == list(range(9)):
            own = [its[i] for i in range(9)]
            check = "that the matrix stands row by row"
            return VectorColumns("orientation", _rows(own), label_of(words), (check,))
    return None


def _rows(cells: Sequence[Name]) -> dict[str, Name]:
    """Nine elements of a matrix, row by row, by their columns of the contract."""
    return {f"r{i // 3 + 1}{i % 3 + 1}": cell for i, cell in enumerate(cells)}


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
