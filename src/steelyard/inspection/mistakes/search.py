"""Which simple mistakes a recording gives away: descriptions amended by one of them, compared with
the present one.

A mistake is named where the present description fits badly and the amended one much better, in all
agreements together: what is wrong shows in how many others then agree. Then the next one is looked
for, until nothing is bad or nothing helps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.agreement import InstrumentAgreement
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.judgement import Judged, evaluated, judged
from steelyard.inspection.agreements.motion import Relation, is_of_motion
from steelyard.inspection.mistakes.amendment import ROBOT, Amendment, Change
from steelyard.inspection.mistakes.catalogue import amendments, clock_amendments
from steelyard.inspection.mistakes.clocks import SYNC_AUTO
from steelyard.inspection.mistakes.settings import MISTAKES, MistakeSettings

_LEAST_PART = 0.1
"""Part of a run that an amendment must leave to look at."""


@dataclass(frozen=True, eq=False)
class Mistake:
    """One that was found."""

    amendment: Amendment
    run: str
    before: tuple[InstrumentAgreement, ...]
    """Agreements that it spoils, as they are."""
    after: tuple[InstrumentAgreement, ...]
    """The same with the amended description."""
    gain: float
    others: tuple[str, ...]
    """Other explanations that are about as good."""
    said: str = ""
    """Where it shows, of a mistake that no comparison has shown."""
    is_doubtful: bool = False
    """Whether what shows it may as well be stated wrongly itself, so that an estimate is worth its
    time."""

    @property
    def evidence(self) -> str:
        """Where it shows most, in words."""
        if self.said:
            return self.said
        pairs = list(zip(self.before, self.after, strict=True))
        spoilt = [pair for pair in pairs if not pair[0].agrees] or pairs[:1]
        b, a = max(spoilt, key=lambda pair: pair[0].cost - pair[1].cost)
        i = int(np.argmax(b.ratio))
        channel = b.channels[i]
        left = a.ratio[a.channels.index(channel)] if channel in a.channels else a.worst
        return (
            f"{b.name}: {channel} is off by {b.ratio[i]:.2g} times what is allowed, by {left:.2g}"
            " times then"
        )


@dataclass(frozen=True, eq=False)
class _Trial:
    """An amendment that helps."""

    gain: float
    amendment: Amendment
    excerpt: Excerpt
    before: Mapping[Relation, InstrumentAgreement]
    """What it is held against: the agreements as described, of the same part of the run."""
    after: dict[Relation, InstrumentAgreement]

    @property
    def likelihood(self) -> float:
        """How much it explains, however rare it is."""
        return self.gain + self.amendment.cost


def _comparable(
    after: InstrumentAgreement, before: InstrumentAgreement, settings: MistakeSettings
) -> InstrumentAgreement:
    """The agreement with an amended description, which may not be better for allowing more than the
    one before: noise that a change makes larger explains nothing.
    """
    axes = after.measured.shape[1]
    if len(before.allowed) < axes:
        # Of one account alone, which has limits of its own.
        return after
    now, then = (np.var(each.measured, axis=0) for each in (before, after))
    now, then = np.append(now, np.mean(now)), np.append(then, np.mean(then))
    grown = np.sqrt(then / (now + 1e-300))
    # What is compared may have another unit: an axis of it, or all.
    grown = np.maximum(grown[:-1], grown[-1])
    limits = settings.wider * before.allowed[:axes] * grown
    most = dict(zip(before.channels, limits, strict=False))
    allowed = after.allowed.copy()
    for i, channel in enumerate(after.channels[:axes]):
        allowed[i] = min(allowed[i], most.get(channel, np.inf))
    gone = [i for i, channel in enumerate(before.channels) if channel not in after.channels]
    return replace(
        after,
        channels=(*after.channels, *(before.channels[i] for i in gone)),
        left=np.concatenate([after.left, before.left[gone]]),
        allowed=np.concatenate([allowed, before.allowed[gone]]),
    )


def mistakes(
    excerpt: Excerpt, *, settings: MistakeSettings = MISTAKES
) -> tuple[list[Mistake], Judged]:
    """Find the mistakes of one run, and how everything agrees once they are taken back.

    Args:
        excerpt: Of the run.
        settings: When a mistake is named.
    """
    found: list[Mistake] = []
    now = judged(excerpt)
    while now.bad and len(found) < settings.most:
        # What agrees with nothing first; then all that contradicts anything.
        best = _best(now, settings)
        if best is None:
            break
        mistake, now = best
        found.append(mistake)
        if mistake.amendment.proposal == SYNC_AUTO:
            # All clocks are found together then; what else contradicts the clocks has to wait.
            break
    return found, now


def _best(now: Judged, settings: MistakeSettings) -> tuple[Mistake, Judged] | None:
    """The amendment that helps most, if it helps enough: of what agrees with nothing, or else of
    all that contradicts anything.
    """
    tried: list[_Trial] = []
    begun: set[tuple[str, ...]] = set()
    before: frozenset[Source] = frozenset()
    for suspected in (settings.suspect, 0.0):
        suspects = now.suspects(suspected)
        if set(suspects) == before:
            break
        _try_all(now, suspects, before, tried, begun, settings)
        tried.sort(key=lambda trial: -trial.gain)
        for trial in tried[: settings.considered]:
            if _helps_much(trial, settings) and not _neighbours_help(now, trial, settings):
                return _named(now, trial, tried, settings)
        before = frozenset(suspects)
    return None


def _try_all(
    now: Judged,
    suspects: Sequence[Source],
    before: frozenset[Source],
    tried: list[_Trial],
    begun: set[tuple[str, ...]],
    settings: MistakeSettings,
) -> None:
    """Try the amendments of suspects.

    Args:
        now: What contradicts what.
        suspects: Readings that may be wrong.
        before: Those of an earlier turn, whose clocks have been looked at.
        tried: What helps is added.
        begun: What has been tried; what is tried now is added.
        settings: When a mistake is named.
    """
    total = sum(a.cost for a in now.bad)
    wanted = max(settings.least_gain, settings.share * min(total, settings.enough))
    clocks = partial(clock_amendments, before={name for name, _ in before})
    # Where nobody has said how the clocks are apart, that is the likeliest mistake.
    unsaid = not now.excerpt.run.sync
    tables = (clocks, amendments) if unsaid else (amendments, clocks)
    for candidates in tables:
        best = max((trial.gain for trial in tried), default=0.0)
        if best > settings.plain * total:
            break
        for amendment in candidates(now, suspects, settings):
            if amendment.key in begun:
                continue
            begun.add(amendment.key)
            best = max((trial.gain for trial in tried), default=0.0)
            trial = _tried(now, amendment, max(wanted, best - 2 * settings.equal), settings)
            if trial is None:
                continue
            tried.append(trial)
            if amendment.proposal == SYNC_AUTO and _helps_much(trial, settings):
                # The other clocks are found with this one.
                break


def _tried(
    now: Judged, amendment: Amendment, least: float, settings: MistakeSettings
) -> _Trial | None:
    """An amendment with what it gains; None where that is less than the least that is wanted."""
    touched = [
        relation
        for relation, agreement in now.agreements.items()
        if any(name in amendment.touches for name, _ in relation[1])
        or (ROBOT in amendment.touches and agreement.robot)
    ]
    # What could be gained at best: all that is wrong with these.
    gain = sum(now.agreements[relation].cost for relation in touched) - amendment.cost
    if gain < least:
        return None
    return _evaluated(now, amendment, amendment.change, touched, gain, least, settings)


def _evaluated(
    now: Judged,
    amendment: Amendment,
    change: Change,
    touched: Sequence[Relation],
    gain: float,
    least: float,
    settings: MistakeSettings,
) -> _Trial | None:
    """See :func:`_tried`, with one change.

    Args:
        now: What contradicts what.
        amendment: That is tried.
        change: What is made of the excerpt.
        touched: Agreements that may be others then.
        gain: If these were perfect.
        least: Gain that is wanted.
        settings: How agreements are compared.
    """
    try:
        amended = change(now.excerpt)
    except (ValueError, np.linalg.LinAlgError):
        return None
    if len(amended.time) < _LEAST_PART * len(now.excerpt.time):
        return None
    before = _as_described(now, amended, touched)
    # A shifted clock leaves a part of the run, which may be one in which nothing is wrong.
    gain = min(gain, sum(before[each].cost for each in touched) - amendment.cost)
    if gain < least:
        return None
    after: dict[Relation, InstrumentAgreement] = {}
    # What takes less time first, of that what is worst: most amendments are given up there.
    for relation in sorted(touched, key=lambda r: (not is_of_motion(r), -now.agreements[r].cost)):
        agreement_then = evaluated(amended, relation)
        if agreement_then is None:
            return None
        after[relation] = _comparable(agreement_then, before[relation], settings)
        gain -= after[relation].cost
        if gain < least:
            return None
    return _Trial(gain, amendment, amended, before, after)


def _as_described(
    now: Judged, amended: Excerpt, touched: Sequence[Relation]
) -> Mapping[Relation, InstrumentAgreement]:
    """Agreements as described in the part of the run that an amendment leaves.

    Args:
        now: What contradicts what.
        amended: With the amendment.
        touched: Agreements that may be others then.
    """
    if len(amended.time) == len(now.excerpt.time):
        return now.agreements
    part = now.excerpt.within(float(amended.time[0]), float(amended.time[-1]))
    found = {each: evaluated(part, each) for each in touched}
    return {each: now.agreements[each] if own is None else own for each, own in found.items()}


def _neighbours_help(now: Judged, trial: _Trial, settings: MistakeSettings) -> bool:
    """Whether changes by somewhat more or less explain about as much, so that it is none of
    them.
    """
    amendment, touched = trial.amendment, list(trial.after)
    most = sum(now.agreements[each].cost for each in touched) - amendment.cost
    least = trial.gain - settings.equal
    return any(
        _evaluated(now, amendment, each, touched, most, least, settings) is not None
        for each in amendment.neighbours
    )


def _helps_much(trial: _Trial, settings: MistakeSettings) -> bool:
    """Whether one of the agreements that are bad becomes good, or much better, and none that is
    good becomes bad: what is right contradicts nothing that was so before.
    """
    for relation, after in trial.after.items():
        before = trial.before[relation]
        if before.agrees and not after.agrees and after.worst > settings.spoils * before.worst:
            return False
    for relation, after in trial.after.items():
        before = trial.before[relation]
        limit = max(settings.good, settings.much_better * before.worst)
        if not before.agrees and after.worst < limit:
            return True
    return False


def _named(
    now: Judged, trial: _Trial, tried: Sequence[_Trial], settings: MistakeSettings
) -> tuple[Mistake, Judged]:
    """The mistake that an amendment takes back, and how everything agrees without it."""
    others = dict.fromkeys(
        f"{other.amendment.subject}: {other.amendment.what}"
        for other in tried
        if other is not trial and other.likelihood > trial.likelihood - settings.equal
    )
    mistake = Mistake(
        trial.amendment,
        now.excerpt.run.name,
        tuple(trial.before[relation] for relation in trial.after),
        tuple(trial.after.values()),
        trial.gain,
        tuple(others)[: settings.others],
    )
    # From here on the amended description is the one that others are compared with.
    agreements = dict(now.agreements)
    for relation in trial.after:
        agreement = evaluated(trial.excerpt, relation)
        if agreement is not None:
            agreements[relation] = agreement
    return mistake, Judged(trial.excerpt, agreements)
