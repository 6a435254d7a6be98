"""A study as a document."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.campaigns.study.power import LEVEL as BINOMIAL
from steelyard.campaigns.study.power import SOUND, WRONG
from steelyard.campaigns.study.result import Study
from steelyard.campaigns.study.summary import LEVEL, MethodSummary
from steelyard.digits import LABELS, SHORT_LABELS, deviation, figures, fixed, number
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.blocks.document import Document, Grid, Section, Statement, Statements
from steelyard.report.blocks.shown import slug

_LARGE_RATIO = 10.0


def study_document(found: Study) -> Document:
    """What the draws say, method by method."""
    sections = [
        Section(
            slug(method),
            method,
            (
                _simulated(each) if not found.bootstrap else _resampled(each),
                _judged(each, found),
                *_power(each, found),
            ),
        )
        for method, each in found.methods.items()
    ]
    failed = [Statement(text, "bad") for text in found.problems]
    if failed:
        sections.append(
            Section("failed", "Draws without an estimate", (Statements(tuple(failed)),))
        )
    return Document("Study", _lead(found), tuple(sections))


def _lead(found: Study) -> Statement:
    """The result in one sentence."""
    kind = "resampled recordings" if found.bootstrap else "simulated experiments"
    said = f"{found.draws} {kind} of {found.what}"
    wrong = [
        f"{LABELS[p][0]} ({method})"
        for method, each in found.methods.items()
        for p in range(len(BODY_PARAMETERS))
        if each.outcome(p) == "too small"
    ]
    if not found.methods:
        return Statement(f"{said}; no estimate was made.", "bad")
    if found.bootstrap:
        return Statement(f"{said}: how much estimates differ, against their stated 1-sigma.")
    if wrong:
        return Statement(f"{said}; the stated 1-sigma is too small of {'; '.join(wrong)}.", "bad")
    return Statement(f"{said}; no stated 1-sigma is found too small.", "good")


def _simulated(each: MethodSummary) -> Grid:
    """Errors against the truth."""
    rows = []
    for p, (_, unit, factor) in enumerate(LABELS):
        rows.append(
            (
                SHORT_LABELS[p],
                unit,
                *_errors(each, p, factor),
                deviation(each.bound[p] * factor),
                _ratio(each.rmse[p], each.bound[p]),
                _ratio(each.coverage[p], 1.0),
                _ratio(each.chi_square[p], 1.0),
                each.outcome(p),
            )
        )
    head = (
        *("parameter", "unit", "bias", "rmse", "stated 1-sigma", "bound", "rmse / bound"),
        *(f"coverage of {LEVEL:.0%}", "chi-square / n", "1-sigma is"),
    )
    return Grid(
        f"{each.method}: errors of {each.count} estimates",
        head,
        tuple(rows),
        frozenset(range(2, 9)),
    )


def _resampled(each: MethodSummary) -> Grid:
    """Scatter of what was drawn about the estimate of the whole."""
    rows = tuple(
        (
            SHORT_LABELS[p],
            unit,
            *_errors(each, p, factor),
            _ratio(each.rmse[p], each.stated[p]),
        )
        for p, (_, unit, factor) in enumerate(LABELS)
    )
    head = ("parameter", "unit", "mean shift", "scatter", "stated 1-sigma", "scatter / stated")
    return Grid(
        f"{each.method}: {each.count} estimates about that of the whole recording",
        head,
        rows,
        frozenset(range(2, 6)),
    )


def _errors(each: MethodSummary, p: int, factor: float) -> Iterator[str]:
    """Mean error with the digits that the number of draws leaves; scatter and 1-sigma as such."""
    of_mean = each.rmse[p] / np.sqrt(max(each.known[p], 1))
    yield number(each.bias[p] * factor, of_mean * factor).partition(" ± ")[0]
    yield deviation(each.rmse[p] * factor)
    yield deviation(each.stated[p] * factor)


def _ratio(value: float, unit: float) -> str:
    """A share or a ratio with two digits behind the point, of large ones three in all; a dash where
    there is none.
    """
    share = value / unit if unit else np.nan
    return fixed(share, 2) if share < _LARGE_RATIO else figures(share)


def _power(each: MethodSummary, found: Study) -> Iterator[Grid | Statements]:
    """What the verdict does with sound experiments and with each mistake; nothing where no mistake
    was made.
    """
    own = [judged for judged in found.rejections if judged.method == each.method]
    if not any(judged.mistake for judged in own):
        return
    rows = tuple(
        (
            judged.mistake or "none (false rejections)",
            str(judged.count),
            str(judged.rejected),
            *(fixed(100 * end, 1) for end in judged.interval),
            str(judged.wrong),
        )
        for judged in own
    )
    head = (
        *("mistake", "draws", "rejected", f"{BINOMIAL:.0%} from [%]", "to [%]"),
        "accepted, and wrong",
    )
    marked = frozenset((i, 5) for i, judged in enumerate(own) if judged.wrong)
    yield Grid(
        f"{each.method}: power of the verdict against mistakes, one at a time",
        head,
        rows,
        frozenset(range(1, 6)),
        ruled=frozenset({0}),
        marked=marked,
    )
    yield Statements(
        (
            Statement(
                "Intervals are those of Wilson for the probability of a rejection. Accepted, and"
                " wrong: the errors contradict the stated covariance (probability below"
                f" {WRONG:g}); a mistake that is accepted without that does no harm."
            ),
        )
    )


def _judged(each: MethodSummary, found: Study) -> Statements:
    """Verdicts, and all ten together."""
    return Statements(tuple(_sentences(each, found)))


def _sentences(each: MethodSummary, found: Study) -> Iterator[Statement]:
    """What stands under the table of a method."""
    said = f"{each.method}: {each.accepted} of {each.count} accepted, {each.rejected} rejected"
    for judged in found.rejections:
        if judged.method == each.method and judged.mistake == SOUND:
            low, high = (fixed(100 * end, 1) for end in judged.interval)
            said += (
                f"; rejected ones are false alarms, for nothing is wrong here: {low} to {high} %"
                f" with a probability of {BINOMIAL:.0%}"
            )
    yield Statement(said)
    if not found.bootstrap and each.joint_count:
        limit = 10 + 3 * np.sqrt(20 / each.joint_count)
        yield Statement(
            f"{each.method}: squared error of all ten over their covariance {figures(each.joint)}"
            f" on average of {each.joint_count}; 10 where the covariance is true",
            "bad" if each.joint > limit else "",
        )
    if found.bootstrap:
        yield Statement(
            "Errors that all runs share, such as gains and the robot's geometry, do not scatter: a"
            " scatter below the stated 1-sigma is expected, one above it is not."
        )
