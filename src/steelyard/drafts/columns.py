"""From the names of a log's columns to the instruments that may have written them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from steelyard.drafts.vectors import AXES, CONTRACT, VectorColumns, groups_among, hinted, label_of
from steelyard.drafts.words import COMMANDS, IGNORED, LENGTHS, TENSIONS, TRACKERS, Name, read_name

_NOT_OF_CABLES = IGNORED | frozenset(
    [
        "velocity",
        "vel",
        "speed",
        "torque",
        "tau",
        "acceleration",
        "moment",
        "quat",
        "quaternion",
        "orientation",
    ]
)
"""Words of columns that are neither tensions nor lengths of cables."""
_MOST_TIMES = 5
"""Columns that are tried as the time of an instrument."""


@dataclass(frozen=True)
class Claim:
    """An instrument that some columns of a log may come from."""

    kind: str
    columns: Mapping[str, str]
    """Column of the contract -> column of the log."""
    label: tuple[str, ...] = ()
    """Words of the names that say whose they are: of a sensor or a topic."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Column of the log -> unit that its name ends with."""
    checks: tuple[str, ...] = ()
    """What a person should look at."""
    times: tuple[str, ...] = ()
    """Columns that may be its time, the likeliest first."""


def claims_of(columns: Sequence[str], m: int, hints: Sequence[str]) -> list[Claim]:
    """Guess the instruments in a log.

    Args:
        columns: Their names.
        m: Number of cables of the robot.
        hints: Words of topic, file and folder, which count where the names say nothing.
    """
    single = [column for column, count in Counter(columns).items() if count == 1]
    nameless = _nameless(columns, m, hints)
    if nameless is not None:
        return [nameless]
    names = [read_name(column) for column in single]
    times = [name for name in names if name.is_time]
    names = [name for name in names if not name.is_time]
    commanded = bool(COMMANDS.intersection(hints))
    cables = _per_cable(names, m, hints)
    taken = {column for claim in cables for column in claim.columns.values()}
    rest = [name for name in names if name.column not in taken]
    claims = [*cables, *_instruments(list(groups_among(rest, hints, commanded)))]
    return [_timed(claim, times) for claim in claims]


def _nameless(columns: Sequence[str], m: int, hints: Sequence[str]) -> Claim | None:
    """Columns that have numbers instead of names: as many as an instrument has, with or without a
    time in front.
    """
    if list(columns) != [f"[{i}]" for i in range(len(columns))]:
        return None
    said = hinted(hints) or ("position" if TRACKERS.intersection(hints) else None)
    for first in (1, 0):
        count = len(columns) - first
        if m and count == m:
            wound = {"length", "lengths", "winch", "winches", "encoder", "encoders"}
            kind, contract = ("length", "l") if wound.intersection(hints) else ("tension", "f")
            names = [f"{contract}{i + 1}" for i in range(m)]
        elif count == 3 and said in {"angular_velocity", "specific_force", "position"}:
            kind = "position" if said == "position" else "imu"
            names = [f"{CONTRACT[said]}{axis}" for axis in AXES]
        elif count == 6 and (
            said in {"force", "torque"} or {"wrench", "fts", "ft"}.intersection(hints)
        ):
            kind, names = "wrench", [f"{letter}{axis}" for letter in "ft" for axis in AXES]
        elif count == 6 and COMMANDS.intersection(hints):
            kind, names = "command", [*AXES, "roll", "pitch", "yaw"]
        else:
            continue
        checks = ("that the columns stand in this order: they have no names",)
        columns_of = dict(zip(names, columns[first:], strict=True))
        return Claim(kind, columns_of, checks=checks, times=tuple(columns[:first]))
    return None


def _timed(claim: Claim, times: Sequence[Name]) -> Claim:
    """The claim with columns of its time: of its own message, the device's stamp before that of the
    recorder.
    """

    def fit(name: Name) -> tuple[bool, bool, bool]:
        label = label_of(name.words[:-1])
        return label != claim.label, bool(label) and label != claim.label, "receive" in name.words

    order = sorted(times, key=fit)[:_MOST_TIMES]
    units = {name.column: name.unit for name in order if name.unit}
    return replace(
        claim, times=tuple(name.column for name in order), units={**claim.units, **units}
    )


def _per_cable(names: Sequence[Name], m: int, hints: Sequence[str]) -> list[Claim]:
    """Columns that are there once for every cable."""
    if not m:
        return []
    templates: dict[tuple[str, ...], dict[int, Name]] = {}
    for name in names:
        for place in name.numbers:
            templates.setdefault(name.template(place), {})[int(name.words[place])] = name
    found: dict[str, Claim] = {}
    undecided: list[tuple[tuple[str, ...], dict[int, Name]]] = []
    for template, members in templates.items():
        first = min(members)
        if first not in {0, 1} or sorted(members) != list(range(first, first + m)):
            continue
        kind = _cable_kind(template)
        if kind is None:
            undecided.append((template, members))
        elif kind and kind not in found:
            found[kind] = _cable_claim(kind, template, members)
    wound = {"length", "lengths", "winch", "winches", "encoder"}
    likely = "length" if wound.intersection(hints) else "tension"
    if undecided and likely not in found:
        check = (
            f"that these columns are a {likely} of each cable: their names do not say what they are"
        )
        found[likely] = replace(_cable_claim(likely, *undecided[0]), checks=(check,))
    return list(found.values())


def _cable_kind(template: tuple[str, ...]) -> str | None:
    """Kind that the words of a template mean; None: they do not say; "": something else."""
    if _NOT_OF_CABLES.intersection(template):
        return ""
    for word in reversed(template):
        if word in TENSIONS:
            return "tension"
        if word in LENGTHS:
            return "length"
    return None


def _cable_claim(kind: str, template: tuple[str, ...], members: Mapping[int, Name]) -> Claim:
    letter = {"tension": "f", "length": "l"}[kind]
    in_order = [members[number] for number in sorted(members)]
    return Claim(
        kind,
        {f"{letter}{i + 1}": name.column for i, name in enumerate(in_order)},
        label_of(template),
        {name.column: name.unit for name in in_order if name.unit},
        ("that the cables are numbered as in the robot file",),
    )


def _instruments(groups: Sequence[VectorColumns]) -> Iterable[Claim]:
    """Groups of one sensor together, each orientation with the sensor that it most likely is of."""
    labels = list(dict.fromkeys((group.label, group.commanded) for group in groups))
    for label, commanded in labels:
        its: dict[str, list[VectorColumns]] = {}
        for group in groups:
            if (group.label, group.commanded) == (label, commanded):
                its.setdefault(group.quantity, []).append(group)
        turned = sorted(its.get("orientation", []), key=_form)
        if commanded:
            angles = [group for group in turned if "roll" in group.columns]
            if its.get("position") and angles:
                yield _claim("command", [its["position"][0], angles[0]])
            continue
        inertial = [its[q][0] for q in ("angular_velocity", "specific_force") if q in its]
        if inertial:
            # An accelerometer alone knows no orientation; a matrix comes from an arm or a tracker.
            own = [g for g in turned if "r11" not in g.columns and "angular_velocity" in its][:1]
            if len(own) == len(turned) == 1 and "position" in its and "roll" in own[0].columns:
                own = []
            turned = [group for group in turned if group not in own]
            yield _claim("imu", [*inertial, *own])
        if "force" in its and "torque" in its:
            yield _claim("wrench", [its["force"][0], its["torque"][0]])
        places = its.get("position", [])
        if places and turned:
            yield _claim("pose", [places[0], turned.pop(0)])
            places = places[1:]
        for group in places:
            yield _claim("position", [group])
        for group in turned:
            yield _claim("attitude", [group])


def _form(group: VectorColumns) -> int:
    """Quaternions before angles before matrices, as the contract looks for them."""
    first = [column for column in ("qw", "roll", "r11") if column in group.columns]
    return ("qw", "roll", "r11").index(first[0])


def _claim(kind: str, groups: Sequence[VectorColumns]) -> Claim:
    """An instrument of a kind that has the columns of these vectors."""
    names: dict[str, Name] = {}
    checks: list[str] = []
    for group in groups:
        names.update(group.columns)
        checks += group.checks
    columns = {contract: name.column for contract, name in names.items()}
    units = {name.column: name.unit for name in names.values() if name.unit}
    return Claim(kind, columns, groups[0].label, units, tuple(checks))
