"""The text of a first experiment file: what was guessed and why, what to check, and all that one
may want to fill in.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from steelyard.display import printable
from steelyard.drafts.arrange import DraftRun
from steelyard.drafts.draft import Draft
from steelyard.drafts.survey import DraftStream, instrument_of
from steelyard.experiment.form import FORMAT, UncertaintyForm
from steelyard.instruments.base import DEFAULT_DELAY
from steelyard.robot.model import Robot

SCHEMA = "experiment.schema.json"
"""Beside an experiment file, for editors."""
_PLAIN = re.compile(r"(\.{1,2}/)*[A-Za-z_][\w./\-]*", re.ASCII)
_WORDS = frozenset(["true", "false", "null", "yes", "no", "on", "off", "nan", "inf", "y", "n"])
_WIDTH = 110
"""Characters of a line of the file."""
_POSITION = "origin of the instrument in the platform frame [m]"
_RPY = "instrument frame -> platform frame, R = Rz(yaw) Ry(pitch) Rx(roll) [deg]"
_ZEROS = "[0.0, 0.0, 0.0]"
_FRAME = (
    "frame",
    "{position: [0, 0, 0], rpy_deg: [0, 0, 0]}",
    "tracker frame in the world frame [m], [deg]",
)


def _noise(example: str, units: str) -> tuple[str, str, str]:
    return "noise", example, f"1-sigma per sample {units}; default: estimated"


_KEYS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "tension": (
        ("end", "winch", "where the sensors sit at the winches; default: platform"),
        _noise("5.0", "[N]"),
    ),
    "wrench": (
        ("position", _ZEROS, _POSITION.replace("instrument", "sensor")),
        ("rpy_deg", _ZEROS, _RPY.replace("instrument", "sensor")),
        ("acts_on", "body", "whose load the log has: body, or sensor"),
        _noise("{force: 0.1, torque: 0.01}", "[N], [N m]"),
    ),
    "imu": (
        ("position", _ZEROS, _POSITION),
        ("rpy_deg", _ZEROS, _RPY),
        ("gravity", "included", "removed, where the device took it out"),
        _noise(
            "{angular_velocity: 0.002, specific_force: 0.03, orientation: 0.005}",
            "[rad/s], [m/s^2], [rad]",
        ),
    ),
    "attitude": (("rpy_deg", _ZEROS, _RPY), _noise("0.005", "[rad]")),
    "position": (
        ("target", _ZEROS, "tracked point in the platform frame [m]"),
        _FRAME,
        _noise("0.0005", "[m]"),
    ),
    "pose": (
        ("position", _ZEROS, _POSITION.replace("instrument", "tracked frame")),
        ("rpy_deg", _ZEROS, _RPY.replace("instrument", "tracked")),
        _FRAME,
        _noise("{position: 0.0005, rotation: 0.001}", "[m], [rad]"),
    ),
    "length": (_noise("0.001", "[m]"),),
    "command": (
        (
            "noise",
            "{position: 0.01, rotation: 0.01}",
            "how far the platform may be from it [m], [rad]; default: no measurement",
        ),
    ),
}
"""Kind -> keys that a person fills in: an example or the default, and what it means."""
_PLACE = {"imu": "position", "position": "target"}
"""Kind -> key of a place on the platform that no log tells."""
_LEAST_PLACE = 0.3
"""1-sigma of a place that is not known, at least [m]."""
_WIDE = (
    "1-sigma [m]: '{}' is not known, anywhere on the platform; state it, and 0.005 here, once it is"
    " measured"
)
_GEOMETRY = {
    "wrench": "position and rpy_deg: where the sensor sits",
    "imu": "position and rpy_deg: where the IMU sits",
    "attitude": "rpy_deg: how its frame stands in the platform",
    "position": "target: where the tracked point sits; frame: where the tracker stands",
    "pose": "position and rpy_deg: where the tracked frame sits; frame: where the tracker stands",
}


def as_text(
    draft: Draft,
    robot: Robot,
    *,
    name: str,
    robot_place: str,
    files: Mapping[str, str],
    with_schema: bool,
) -> str:
    """The file of a draft.

    Args:
        draft: What was guessed.
        robot: What the instruments are on.
        name: Of the experiment.
        robot_place: Bundled name, or path of the robot file relative to the file.
        files: Path of a log -> the same relative to the file.
        with_schema: Whether a schema for editors lies beside it.
    """
    schema = [f"# yaml-language-server: $schema={SCHEMA}"] if with_schema else []
    lines = [
        *schema,
        "# A first experiment file, drafted by 'steelyard init' from logs. What was guessed says"
        " why; look at every 'check'.",
        f"format: {FORMAT}",
        f"name: {scalar(name)}",
        f"robot: {scalar(robot_place)}",
        "# known: {mass: {value: 100.0, sigma: 0.1}}    # known beforehand [kg]; also"
        " center_of_gravity: {x: …} [m], inertia: {xx: …} [kg m^2]",
        f"# uncertainty: {flow(UncertaintyForm().of_robot)}    # 1-sigma of the robot file [m],"
        " [m], [m/s^2]; the defaults",
        "instruments:",
    ]
    for each, keys in draft.instruments.items():
        lines += _instrument(each, keys, draft.runs, robot)
    lines.append("runs:")
    for run in draft.runs:
        lines += _run(run, draft.instruments, files)
    lines += [f"# not used: {comment(f'{each.log}: {each.what}')}" for each in draft.unused]
    return "\n".join(lines) + "\n"


def _instrument(
    name: str, keys: Mapping[str, Any], runs: Sequence[DraftRun], robot: Robot
) -> Iterator[str]:
    """Lines of an instrument: what was guessed, what to check, and what may be added."""
    m = robot.m
    found = [run.streams[name] for run in runs if name in run.streams]
    kind = str(keys["kind"])
    yield f"  {scalar(name)}:"
    for key, value in keys.items():
        yield f"    {key}: {flow(value)}"
    rate = next((each.rate for each in found if each.rate), None)
    if rate is not None:
        yield f"    rate: {rate:.4g}    # [Hz], as recorded; read by simulate and design"
    geometry = [_GEOMETRY[kind]] if kind in _GEOMETRY else []
    for check in dict.fromkeys([*geometry, *(c for each in found for c in each.checks)]):
        yield f"    # check: {comment(check)}"
    for key, example, meaning in _KEYS[kind]:
        if key not in keys:
            yield f"    # {key}: {example}    # {meaning}"
    place = _PLACE.get(kind)
    stated = dict(keys)
    if place is not None and place not in keys and "calibration" not in keys:
        wide = max(_LEAST_PLACE, round(robot.size, 1)) if m else _LEAST_PLACE
        stated["calibration"] = {place: wide}
        yield f"    calibration: {flow(stated['calibration'])}    # {_WIDE.format(place)}"
    yield f"    # {_calibration(stated, m)}"
    if "clock" not in keys:
        yield "    # clock: recorder    # instruments with the same clock share its error"


def _calibration(keys: Mapping[str, Any], m: int) -> str:
    """Systematic errors with their defaults, as they would stand in the file."""
    nested: dict[str, Any] = {}
    units = []
    for term in instrument_of(str(keys["kind"]), keys).terms(m):
        deviation = term.deviation
        if deviation is None or term.key in keys.get("calibration", {}):
            continue
        group, _, key = term.key.rpartition(".")
        (nested.setdefault(group, {}) if group else nested)[key] = float(deviation[0])
        units.append(f"[{term.unit}]")
    nested["delay"] = DEFAULT_DELAY
    more = "calibration" in keys
    extra = "; they go beside what stands above" if more else ""
    return (
        f"{'more of calibration' if more else 'calibration'}: {flow(nested)}    # 1-sigma"
        f" {', '.join([*units, '[s]'])}; the defaults (delay: 0 for the clock of the forces){extra}"
    )


def _run(run: DraftRun, instruments: Iterable[str], files: Mapping[str, str]) -> Iterator[str]:
    """Lines of a run: its streams, clocks and window."""
    yield f"  - name: {scalar(run.name)}"
    if run.static:
        yield "    static: true    # no column of time: rows are poses at rest"
    names = [name for name in instruments if name in run.streams]
    for name in names:
        yield from _stream(name, run.streams[name], files)
    if run.static:
        return
    shared = "{" + ", ".join(f"{scalar(name)}: 0.0" for name in names) + "}"
    if run.agree:
        yield f"    # check: that the clocks agree: {comment(run.why)}"
        yield f"    # sync: {shared}    # else: time of one common event on each clock [s], or auto"
    else:
        yield f"    sync: auto    # {comment(run.why)}"
        better = "better, if known: time of one common event on each clock [s]"
        yield f"    # sync: {shared}    # {better}"
    longest = max(end - start for start, end in (each.span for each in run.streams.values()))
    yield (
        f"    # window: [0.5, {max(longest - 0.5, 1):.1f}]    # part to use [s], after that event"
        " (without sync: after the first force sample)"
    )


def _stream(name: str, found: DraftStream, files: Mapping[str, str]) -> Iterator[str]:
    """Lines of a stream: its file, columns and units, and why."""
    place = found.place
    file = scalar(files[str(place.path)])
    counted = f"{len(found.times)} {'poses' if found.static else 'samples'}"
    if found.rate:
        counted += f", {found.rate:.4g} Hz"
    if not (place.topic or place.columns or place.units):
        yield f"    {scalar(name)}: {file}    # {counted}"
    else:
        yield f"    {scalar(name)}:    # {counted}"
        yield f"      file: {file}"
        if place.topic is not None:
            yield f"      topic: {scalar(place.topic)}"
        yield from _mapping("columns", place.columns)
        yield from _mapping("units", place.units)
    for why in found.why:
        yield f"      # {comment(why)}"
    if found.stated:
        units = ", ".join(dict.fromkeys(found.stated.values()))
        yield f"      # the log itself states units: {comment(units)}"


def _mapping(key: str, values: Mapping[str, str]) -> Iterator[str]:
    """A mapping in one line where it fits, else a line for each entry; nothing where it is
    empty.
    """
    short = f"      {key}: {flow(values)}"
    if values and len(short) <= _WIDTH:
        yield short
    elif values:
        yield f"      {key}:"
        for name, value in values.items():
            yield f"        {scalar(name)}: {scalar(value)}"


def flow(value: Any) -> str:
    """A value in one line."""
    if isinstance(value, Mapping):
        entries = [f"{scalar(str(key))}: {flow(entry)}" for key, entry in value.items()]
        return "{" + ", ".join(entries) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(flow(entry) for entry in value) + "]"
    if isinstance(value, str):
        return scalar(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def scalar(text: str) -> str:
    """A text as YAML: plain where that is certainly what it means, else quoted with all that might
    steer a reader escaped.
    """
    if _PLAIN.fullmatch(text) and text.lower() not in _WORDS:
        return text
    return '"' + "".join(map(_escaped, text)) + '"'


def _escaped(letter: str) -> str:
    """A letter between quotation marks of YAML."""
    if letter in '"\\':
        return f"\\{letter}"
    if letter.isprintable():
        return letter
    return f"\\U{ord(letter):08X}" if ord(letter) > 0xFFFF else f"\\u{ord(letter):04X}"


def comment(text: str) -> str:
    """A text as part of a comment: one line, nothing but what can be seen."""
    line = printable(text)
    return line if len(line) <= 300 else line[:299] + "…"
