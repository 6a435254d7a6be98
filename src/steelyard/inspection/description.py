"""Whether a description can be right, before anything is estimated with it: the cheap part of an
inspection, and what to paste into the experiment file where it cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.mistakes.amendment import ROBOT
from steelyard.inspection.mistakes.search import Mistake, mistakes
from steelyard.inspection.mistakes.sizes import size_mistakes
from steelyard.inspection.settings import INSPECTION, InspectionSettings

Progress = Callable[[str, float], None] | None


@dataclass(frozen=True, eq=False)
class DescriptionCheck:
    """Mistakes of a description."""

    mistakes: tuple[Mistake, ...]
    """Each once, in the run where it shows most; first those that explain most."""
    runs_of: tuple[tuple[str, ...], ...]
    """Of each mistake the runs that show it."""

    @property
    def is_certain(self) -> bool:
        """Whether no estimate with this description is worth its time."""
        return any(not each.is_doubtful for each in self.mistakes)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why no estimate with this description is to be relied on, each with its evidence."""
        return tuple(
            f"{each.amendment.subject}: {each.amendment.what} ({each.evidence}); change"
            f" {', '.join(each.amendment.keys) or each.amendment.proposal}"
            + (", or its 'noise', where that is not known" if each.is_doubtful else "")
            for each in self.mistakes
        )

    @property
    def amendment(self) -> str:
        """YAML to merge into the experiment file; empty where no key of it takes a mistake back."""
        instruments: dict[str, list[str]] = {}
        runs: dict[str, list[str]] = {}
        robot: list[str] = []
        for mistake, own in zip(self.mistakes, self.runs_of, strict=True):
            amendment = mistake.amendment
            if amendment.subject == ROBOT:
                robot.append(f"# {amendment.proposal}")
            elif amendment.proposal.startswith("sync:"):
                for run in own:
                    runs.setdefault(run, []).append(amendment.proposal)
            elif amendment.keys:
                instruments.setdefault(amendment.subject, []).extend(_with_others(mistake))
        lines = robot
        if instruments:
            lines.append("instruments:")
            for name, keys in instruments.items():
                lines += [f"  {name}:", *(f"    {key}" for key in dict.fromkeys(keys))]
        if runs:
            lines.append("runs:")
            for name, keys in runs.items():
                lines += [f"  - name: {name}", *(f"    {key}" for key in dict.fromkeys(keys))]
        return "\n".join(lines)


def check_description(
    experiment: Experiment,
    progress: Progress = None,
    *,
    settings: InspectionSettings = INSPECTION,
) -> DescriptionCheck:
    """Look for mistakes of units, signs, axes, orders, places and clocks in a few runs.

    Args:
        experiment: With its clocks found, where they are to be found.
        progress: Is told what is being done and the fraction that is done.
        settings: How much is looked at, and what is named.
    """
    tell = progress or (lambda what, fraction: None)
    tell("checking the description", 0.0)
    by_size = size_mistakes(experiment, settings.sizes)
    if any(each.amendment.subject == ROBOT for each in by_size):
        return merged(by_size)
    found = list(by_size)
    with np.errstate(all="ignore"):
        try:
            # Each load by what is known of it.
            alone = [experiment.alone(load) for load in experiment.loads] or [experiment]
            shown = [
                each
                for part in alone
                for each in excerpts(part, settings.checked, settings.agreements)
            ][: 2 * settings.checked]
        except InputError:
            # What cannot be read is said by those who need it.
            shown = []
        for i, excerpt in enumerate(shown):
            tell("checking the description", i / len(shown))
            found += mistakes(excerpt, settings=settings.mistakes)[0]
    return merged(found)


def merged(found: Sequence[Mistake]) -> DescriptionCheck:
    """Each mistake once, with all runs that show it; first those that explain most.

    Args:
        found: In any order, of any run.
    """
    groups: dict[tuple[str, str, str], list[Mistake]] = {}
    for mistake in found:
        a = mistake.amendment
        groups.setdefault((a.subject, a.kind, a.proposal), []).append(mistake)
    best = {max(group, key=lambda m: m.gain): group for group in groups.values()}
    named = sorted(best, key=lambda m: -m.gain)
    return DescriptionCheck(
        tuple(named), tuple(tuple(m.run for m in best[mistake]) for mistake in named)
    )


def _with_others(mistake: Mistake) -> list[str]:
    """Keys of a mistake, with the explanations that are about as good as a comment."""
    *first, last = mistake.amendment.keys
    others = [each.partition(": ")[2] for each in mistake.others]
    return [*first, f"{last}    # or it {' or '.join(others)}" if others else last]
