"""Parts of pages that are drawn from the code, so that they never differ from it: a line ``<!--
generated: NAME -->`` becomes Markdown.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import click
from sphinx.application import Sphinx

from steelyard.cli import app as command_line
from steelyard.experiment.schema import Which, schema
from steelyard.instruments import Instrument, Tension
from steelyard.instruments.base import ORIENTATION_FORMS, Term
from steelyard.logs.formats import FORMATS
from steelyard.units import FACTORS

_MARK = re.compile(r"^<!-- generated: ([a-z ]+) -->$", re.MULTILINE)
_CABLES = 2
"""Of a robot whose columns are shown: the first, and the last."""


def commands() -> str:
    """Every verb with its arguments and options, as the command line itself knows them."""
    top = click.Context(command_line, info_name="steelyard")
    return "\n".join(line for name in command_line.list_commands(top) for line in _verb(top, name))


def _verb(top: click.Context, name: str) -> Iterator[str]:
    command = command_line.get_command(top, name)
    assert command is not None
    context = click.Context(command, info_name=name, parent=top)
    yield f"## {name}\n"
    yield (
        f"```text\n{context.command_path} {' '.join(command.collect_usage_pieces(context))}\n```\n"
    )
    yield f"{_paragraphs(command.help or '')}\n"
    yield "| option | |\n|---|---|"
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record:
            yield f"| `{_cell(record[0])}` | {_cell(record[1])} |"
    yield ""


def _paragraphs(text: str) -> str:
    """Help as Markdown: words in capitals are arguments."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def instruments() -> str:
    """The kinds: columns, keys, systematic errors with their defaults."""
    return "\n".join(line for kind in _kinds() for line in _instrument(kind))


def _kinds() -> Iterator[type[Instrument]]:
    whole = schema("experiment")
    by_name = {kind.__name__: kind for kind in Instrument.__subclasses__()}
    for reference in whole["properties"]["instruments"]["additionalProperties"]["oneOf"]:
        yield by_name[reference["$ref"].rpartition("/")[2]]


def _instrument(kind: type[Instrument]) -> Iterator[str]:
    whole = schema("experiment")
    form = whole["$defs"][kind.__name__]
    name = form["properties"]["kind"]["const"]
    yield f"### `{name}`\n\n{form['description']}\n"
    yield "| columns | unit | reads | noise | |\n|---|---|---|---|---|"
    # Keys without a default say nothing about columns and errors.
    instrument = kind.model_construct(kind=name)
    for quantity in instrument.quantities(_CABLES):
        several = " or ".join(f"`{_columns(form)}`" for form in quantity.forms)
        unit = "rad, of angles" if quantity.forms == ORIENTATION_FORMS else quantity.unit
        noise = (
            "`noise`"
            if "noise" in form["properties"] and _is_number(form["properties"]["noise"])
            else _noise_key(kind, quantity.name)
        )
        yield (
            f"| {several} | {unit} | {quantity.name.replace('_', ' ')} | {noise} |"
            f" {'' if quantity.required else 'may be absent'} |"
        )
    yield "\n| key | default | |\n|---|---|---|"
    yield from _keys(whole, form, skip=("kind", "calibration"))
    terms = {term.key: term for term in _terms(kind, instrument)}
    described = dict(_leaves(whole, whole["$defs"][_calibration(form)]))
    yield "\n| under `calibration` | 1-sigma, default | | size |\n|---|---|---|---|"
    for key, text in described.items():
        yield _term(
            key,
            text,
            terms.get(key),
            per_cable=any(
                quantity.forms[0][-1][1:].isdigit() for quantity in instrument.quantities(_CABLES)
            ),
        )
    yield ""


def _terms(kind: type[Instrument], instrument: Instrument) -> tuple[Term, ...]:
    """All that there may be: of sensors in the cables, those behind rollers."""
    if kind is Tension:
        return Tension(kind="tension", end="winch").terms(_CABLES)
    return instrument.terms(_CABLES)


def _term(key: str, text: str, term: Term | None, *, per_cable: bool) -> str:
    text, _, _ = text.partition(" Default:")
    text, _, stated = text.partition("; default: ")
    if term is None and key != "delay":
        # Errors that go on for a while: none is assumed, and most are looked for.
        return f"| `{key}` | not stated | {_sentence(text.partition('; without it')[0])} | each |"
    if term is None:
        return (
            f"| `{key}` | .05 s; 0 for the clock that defines the time |"
            f" {_sentence(text.partition(';')[0])} | 1, per run |"
        )
    default = stated.rstrip(".") or ("" if term.deviation is None else f"{term.deviation[0]:g}")
    size = (
        "each cable"
        if per_cable and term.size == _CABLES
        else "each axis"
        if term.size == 3
        else "1"
    )
    unit = "" if term.unit == "1" else f" {term.unit}"
    return (
        f"| `{key}` | {default}{'' if stated else unit} |"
        f" {_sentence(text.partition('; without it')[0])} | {size} |"
    )


def _sentence(text: str) -> str:
    return _cell(text).rstrip(".")


def _columns(form: tuple[str, ...]) -> str:
    if form[-1][1:] == str(_CABLES) and form[0][1:] == "1":
        return f"{form[0]} … {form[0][0]}m"
    return " ".join(form)


def _noise_key(kind: type[Instrument], quantity: str) -> str:
    noise = kind.model_fields.get("noise")
    fields = getattr(noise.annotation, "model_fields", {}) if noise else {}
    key = (
        quantity
        if quantity in fields
        else "rotation"
        if quantity == "orientation" and "rotation" in fields
        else None
    )
    return f"`noise: {{{key}: …}}`" if key else ""


def _is_number(entry: Mapping[str, Any]) -> bool:
    return any(branch.get("type") == "number" for branch in entry.get("anyOf", ()))


def _calibration(form: Mapping[str, Any]) -> str:
    return str(form["properties"]["calibration"]["$ref"]).rpartition("/")[2]


def _leaves(
    whole: Mapping[str, Any], form: Mapping[str, Any], path: str = ""
) -> Iterator[tuple[str, str]]:
    """Dotted key -> description."""
    for key, entry in form["properties"].items():
        inner = _form_of(whole, entry)
        if inner is not None and "properties" in inner:
            yield from _leaves(whole, inner, f"{path}{key}.")
        else:
            yield f"{path}{key}", entry.get("description", "")


def _form_of(whole: Mapping[str, Any], entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The form that a key refers to, also where it may be absent."""
    references = [branch["$ref"] for branch in (entry, *entry.get("anyOf", ())) if "$ref" in branch]
    return whole["$defs"][references[0].rpartition("/")[2]] if references else None


def _keys(
    whole: Mapping[str, Any], form: Mapping[str, Any], path: str = "", skip: tuple[str, ...] = ()
) -> Iterator[str]:
    """Rows of a table: key, default, description."""
    required = form.get("required", ())
    for key, entry in form["properties"].items():
        if key in skip:
            continue
        inner = _form_of(whole, entry)
        name = f"{path}{key}"
        text = entry.get("description") or (inner or {}).get("description", "")
        text, _, stated = text.partition("Default: ")
        default = "required" if key in required else stated.rstrip(".") or _default(entry)
        yield f"| `{name}` | {default} | {_cell(text).rstrip('. ')}{_choices(entry)} |"
        if inner is not None and "properties" in inner:
            yield from _keys(whole, inner, f"{name}.", skip)


def _default(entry: Mapping[str, Any]) -> str:
    value = entry.get("default")
    return "" if value is None else json.dumps(value)


def _choices(entry: Mapping[str, Any]) -> str:
    return f" ({', '.join(f'`{each}`' for each in entry['enum'])})" if "enum" in entry else ""


def file_keys(which: Which, *parts: str) -> str:
    """Keys of a file, or of some of its parts."""
    whole = schema(which)
    rows: list[str] = ["| key | default | |", "|---|---|---|"]
    if not parts:
        rows += _keys(whole, whole)
    for part in parts:
        form = whole["$defs"][part]
        rows += _keys(
            whole, next((each for each in form.get("anyOf", ()) if "properties" in each), form)
        )
    return "\n".join(rows)


def experiment() -> str:
    """Keys of the experiment file, but for what instruments and runs have."""
    return file_keys("experiment")


def run() -> str:
    """Keys of a run."""
    return file_keys("experiment", "RunForm")


def stream() -> str:
    """Keys of a stream."""
    return file_keys("experiment", "StreamForm")


def robot() -> str:
    """Keys of the robot file."""
    whole = schema("robot")
    rows = ["| key | default | |", "|---|---|---|"]
    for row in _keys(whole, whole):
        rows.append(row)
        if row.startswith("| `cables`"):
            rows += _keys(whole, whole["$defs"]["CableForm"], "cables[].")
    return "\n".join(rows)


def formats() -> str:
    """Endings of logs that can be read."""
    return ", ".join(f"`{ending}`" for ending in FORMATS)


def units() -> str:
    """Units that logs may have."""
    rows = [
        f"| `{si}` | {', '.join(f'`{unit}`' for unit in factors if unit != si)} |"
        for si, factors in FACTORS.items()
        if len(factors) > 1
    ]
    return "\n".join(["| SI | also |", "|---|---|", *rows])


PARTS: Mapping[str, Callable[[], str]] = {
    "commands": commands,
    "instruments": instruments,
    "experiment": experiment,
    "run": run,
    "stream": stream,
    "robot": robot,
    "formats": formats,
    "units": units,
}
"""Name -> what draws it."""


def fill(text: str) -> str:
    """A page with its generated parts."""
    return _MARK.sub(lambda found: PARTS[found[1]](), text)


def _read(_: Sphinx, __: str, content: list[str]) -> None:
    content[0] = fill(content[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Fill pages as they are read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
