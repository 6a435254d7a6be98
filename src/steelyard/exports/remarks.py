"""What goes along with the numbers of every export: where they come from, whether to believe them,
and the convention.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap

from steelyard.exports.exported import Exported
from steelyard.imports.sources import printable
from steelyard.inertia import BODY_PARAMETERS, BODY_UNITS

_WIDTH = 110
"""Characters of a line."""
_LONGEST_NAME = 200
"""Characters of a name from a file."""
_LONGEST_REASON = 2000
"""Characters of a reason from a file."""


def number(value: float) -> str:
    """A number that comes back to the last bit, and that every format takes: an exponent follows a
    decimal point.

    Raises:
        ValueError: It is not finite.
    """
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, found {value}")
    mantissa, exponent, power = repr(float(value) + 0.0).partition("e")
    return f"{mantissa if '.' in mantissa else f'{mantissa}.0'}{exponent}{power}"


def numbers(values: Iterable[float]) -> str:
    """Numbers with blanks between them."""
    return " ".join(number(value) for value in values)


def remarks(exported: Exported, convention: Sequence[str]) -> list[str]:
    """Lines of text for the comment of an export, without what would steer a terminal; each format
    has its own marks to take out.

    Args:
        exported: The estimate.
        convention: Of the format, a paragraph each.
    """
    lines: list[str] = []
    for text in _paragraphs(exported):
        lines += _wrapped(text)
    lines.append("Convention:")
    for text in convention:
        lines += _wrapped(f"- {text}")
    return lines


def one_line(text: str) -> str:
    """Text for a comment of a language of which every control system takes plain letters only."""
    return "".join(c if c.isascii() and c.isprintable() else "_" for c in text)


def _wrapped(text: str) -> list[str]:
    """A paragraph in lines, a table row as it is; what follows a dash is indented."""
    if text.startswith(" "):
        return [text]
    indent = "  " if text.startswith("- ") else ""
    return wrap(text, _WIDTH, subsequent_indent=indent)


def _paragraphs(exported: Exported) -> Iterator[str]:
    """Origin, verdict, and the ten with their 1-sigma."""
    estimate = exported.estimate
    yield f"Inertial parameters of a platform, identified by steelyard {exported.version}."
    origin = f"Method {printable(estimate.method, _LONGEST_NAME)}"
    if exported.experiment:
        origin += f", experiment '{printable(exported.experiment, _LONGEST_NAME)}'"
    if exported.path:
        file = printable(exported.source, _LONGEST_NAME)
        origin += f", from {file} (sha256 {exported.digest})"
    yield f"{origin}."
    verdict = estimate.verdict
    said = verdict.short if verdict.accepted else f"{verdict.short.upper()}, exported all the same"
    yield f"Verdict: {said}."
    if verdict.disagreement:
        yield f"- {printable(verdict.disagreement, _LONGEST_REASON)}"
    for reason in exported.doubts:
        yield f"- {printable(reason, _LONGEST_REASON)}"
    if exported.impossible:
        yield (
            "NO BODY CAN HAVE THESE NUMBERS. MuJoCo refuses them, other simulators and controllers"
            " may become unstable with them. The methods consistent and maximum-likelihood keep to"
            " bodies that can exist; steelyard.nearest_body finds the nearest one."
        )
    yield (
        "Parameters (inertia about the centre of gravity), their 1-sigma, and what determined them:"
    )
    sigma = estimate.standard_deviation
    for name, value, deviation, unit in zip(
        BODY_PARAMETERS, estimate.value, sigma, BODY_UNITS, strict=True
    ):
        label = estimate.verdict.parameters.get(name, "not said")
        known = f"{'not known':>12}"
        if math.isfinite(value):
            known = f"{value:12.6g} +- {deviation:<9.3g} {unit}"
        yield f"  {name:4} {known}, {label}"
    if not exported.correlated:
        yield "The file has no covariance: correlations are not known."
