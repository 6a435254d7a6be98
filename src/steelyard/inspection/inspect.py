"""Everything there is to see in the recordings of an experiment, as one value."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.display import printable
from steelyard.errors import InputError
from steelyard.experiment.equivalent.platform_frame import centred
from steelyard.experiment.given import GivenExperiment, experiment_of
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import gather
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.samples.turned_winches import turned_winches
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.synchronisation import synchronise
from steelyard.identification.verdict.directed_tests import directed_tests
from steelyard.inspection.agreements.agreement import InstrumentAgreement
from steelyard.inspection.agreements.excerpt import Excerpt, excerpts
from steelyard.inspection.agreements.judgement import Judged, judged
from steelyard.inspection.contact import (
    Contact,
    Residual,
    contacts_of_fit,
    unexplained,
)
from steelyard.inspection.delays import Delay, of_excerpt, of_joint
from steelyard.inspection.description import merged
from steelyard.inspection.excitation import Excitation, Identifiability, excitation
from steelyard.inspection.misplaced import Misplaced, misplaced
from steelyard.inspection.mistakes.search import Mistake, mistakes
from steelyard.inspection.mistakes.sizes import size_mistakes
from steelyard.inspection.part import part_of
from steelyard.inspection.remarks import constant_channels, of_noise, of_times
from steelyard.inspection.settings import INSPECTION, InspectionSettings
from steelyard.inspection.streams import StreamReport, as_dict, stream_reports
from steelyard.inspection.swings import ExcitedMode, excited_modes, slack_cables

FORMAT = "steelyard-inspection/1"


Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction that is done."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """What was found."""

    experiment: Experiment
    streams: tuple[StreamReport, ...]
    delays: tuple[Delay, ...]
    agreements: tuple[tuple[str, InstrumentAgreement], ...]
    """Run and agreement, as described."""
    mistakes: tuple[Mistake, ...]
    """Each once, in the run where it shows most."""
    runs_of: tuple[tuple[str, ...], ...]
    """Of each mistake the runs that show it."""
    contacts: tuple[Contact, ...]
    residuals: tuple[Residual, ...]
    """What a body leaves of the forces, over time."""
    excitation: Excitation | None
    """None where it could not be looked at; a remark says why."""
    remarks: tuple[str, ...]
    modes: tuple[ExcitedMode, ...] = ()
    """Natural modes that runs with locked winches show."""
    slack: tuple[SlackCables, ...] = ()
    """Cables that may hang slack for a while, of runs with locked winches and no forces."""
    misplaced: Misplaced | None = None
    """An instrument that the fit of everything finds elsewhere on the platform than stated."""

    def __repr__(self) -> str:
        """Counts, mistakes with what to change, and remarks."""
        amendments = [mistake.amendment for mistake in self.mistakes]
        named = [
            f"mistake: {each.subject}: {each.what}. Change: {each.proposal}" for each in amendments
        ]
        counts = f"{_counted(len(named), 'mistake')}, {_counted(len(self.contacts), 'contact')}"
        first = f"Inspection of '{self.experiment.name}': {counts}"
        return "\n".join(map(printable, [first, *named, *self.remarks]))

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "format": FORMAT,
            "experiment": self.experiment.name,
            "streams": [as_dict(each) for each in self.streams],
            "delays": [each.to_dict() for each in self.delays],
            "agreements": [_agreement_dict(run, each) for run, each in self.agreements],
            "mistakes": [
                _mistake_dict(each, runs)
                for each, runs in zip(self.mistakes, self.runs_of, strict=True)
            ],
            "contacts": [{**vars(each), "channels": list(each.channels)} for each in self.contacts],
            "excitation": None if self.excitation is None else _excitation_dict(self.excitation),
            "modes": [vars(each) for each in self.modes],
            "slack": [each.to_dict() for each in self.slack],
            "remarks": list(self.remarks),
        }


def _counted(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def _agreement_dict(run: str, agreement: InstrumentAgreement) -> dict[str, Any]:
    """Plain values of an agreement."""
    return {
        "run": run,
        "between": agreement.name,
        "agrees": agreement.agrees,
        "channels": {
            channel: {"left": float(left), "allowed": float(allowed)}
            for channel, left, allowed in zip(
                agreement.channels, agreement.left, agreement.allowed, strict=True
            )
        },
    }


def _mistake_dict(mistake: Mistake, runs: Sequence[str]) -> dict[str, Any]:
    """Plain values of a mistake and of the runs that show it."""
    amendment = mistake.amendment
    return {
        "kind": amendment.kind,
        "subject": amendment.subject,
        "channel": amendment.channel,
        "mistake": f"{amendment.subject}: {amendment.what}",
        "proposal": amendment.proposal,
        "evidence": mistake.evidence,
        "runs": list(runs),
        "or": list(mistake.others),
    }


def _excitation_dict(found: Excitation) -> dict[str, Any]:
    """Plain values of what can be known; null for what cannot."""

    def numbers(each: Identifiability) -> dict[str, Any]:
        finite = {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in vars(each).items()
        }
        del finite["name"]
        return finite

    return {
        "body": {each.name: numbers(each) for each in found.body},
        "calibration": {each.name: numbers(each) for each in found.calibration},
    }


def inspect(
    experiment: GivenExperiment,
    progress: Progress | None = None,
    *,
    settings: InspectionSettings = INSPECTION,
) -> Inspection:
    """Look at the recordings of an experiment.

    Args:
        experiment: With at least one run, or the path of its file.
        progress: Called with what is being done and the fraction that is done.
        settings: How much is looked at, and what is named.

    Raises:
        InputError: What an estimator would fail on.
    """
    progress = progress or (lambda what, fraction: None)
    experiment = experiment_of(experiment)
    progress("finding the clocks", 0.0)
    hints = tuple(
        text for run in experiment.runs for text in of_times(experiment, run, settings.remarks)
    )
    try:
        experiment = synchronise(experiment, progress, settings=settings.synchronisation).experiment
        progress("reading the streams", 0.1)
        with np.errstate(all="ignore"):
            shown = list(excerpts(experiment, settings.runs, settings.agreements))
        _enter(experiment, shown, settings)
        of_weights = _of_weights(experiment)
    except InputError as error:
        # The sentence of the estimator, and what physics says of its cause.
        raise InputError("; ".join([str(error), *hints])) from error
    reports = tuple(
        each
        for run in experiment.runs
        for each in stream_reports(experiment, run, settings.streams)
    )
    with np.errstate(all="ignore"):
        described, amended, found = _judge(shown, progress, settings)
        check = merged([*size_mistakes(experiment, settings.sizes), *found])
        named, runs_of = check.mistakes, check.runs_of
        # Once mistakes are corrected, all forces count as sound.
        worst = {} if named else {each.excerpt.run.name: each.worst_of_forces for each in described}
        residuals, contacts = unexplained(amended, worst, settings=settings.contacts)
        # What a mistake leaves looks like a hand on the platform.
        contacts = [] if named else contacts
        delays, joint, remarks = _fitted(
            experiment, shown, bool(named), contacts, progress, settings
        )
    noisy = of_noise(experiment, reports, settings.remarks)
    remarks = [*hints, *of_weights, *constant_channels(experiment), *noisy, *remarks]
    if not named and any(j.bad for j in described) and not contacts:
        remarks.append(_unexplained(described))
    if joint is not None:
        contacts += contacts_of_fit(joint.contacts, residuals, contacts)
    place = None
    if joint is not None and joint.fit.converged:
        place = misplaced(experiment, [vars(each) for each in directed_tests(joint)])
        remarks += [] if place is None else [place.remark]
    swung = [run for run in experiment.runs if run.locked]
    modes = tuple(mode for run in swung for mode in excited_modes(experiment, run))
    slack = () if named else slack_cables(experiment, joint)
    remarks += [*_of_swings(swung, modes, joint), *map(str, slack)]
    progress("done", 1.0)
    return Inspection(
        experiment=experiment,
        streams=reports,
        delays=tuple(delays),
        agreements=tuple(
            (j.excerpt.run.name, replace(a, time=j.excerpt.time))
            for j in described
            for a in j.agreements.values()
        ),
        mistakes=named,
        runs_of=runs_of,
        contacts=tuple(sorted(contacts, key=lambda c: (c.run, c.start))),
        residuals=tuple(residuals),
        excitation=None if joint is None else excitation(joint, settings.identifiability),
        remarks=tuple(dict.fromkeys(remarks)),
        modes=modes,
        slack=slack,
        misplaced=place,
    )


def _of_weights(experiment: Experiment) -> list[str]:
    """Readings under dead weights, which are no stream in time, and what is wrong with them."""
    weighed = gather(experiment).weighed if experiment.weights else None
    if weighed is None:
        return []
    return [*map(str, weighed.tables), *map(str, weighed.wrong), *weighed.reasons]


def _of_swings(
    runs: Sequence[Run], modes: Sequence[ExcitedMode], joint: Posterior | None
) -> Iterator[str]:
    """Winches that have turned though they are said to be locked, and runs in which nothing
    swings.
    """
    if joint is not None:
        for samples in joint.samples:
            yield from turned_winches(joint.experiment, samples)
    for run in runs:
        if not any(mode.run == run.name for mode in modes):
            yield (
                f"run '{run.name}': no swing is seen; push the platform and record at least some"
                " seconds once the hands are off"
            )


def _enter(experiment: Experiment, shown: Sequence[Excerpt], settings: InspectionSettings) -> None:
    """What every estimator begins with, on a part of long runs; raises what it would."""
    parts = {excerpt.run.name: excerpt for excerpt in shown if not excerpt.static}
    for run in experiment.runs:
        window = parts[run.name].window if run.name in parts else run.window
        prepare(
            experiment,
            replace(run, window=window),
            thin=True,
            commanded=True,
            settings=settings.fit.motion.preparation,
        )


def _judge(
    shown: Sequence[Excerpt], progress: Progress, settings: InspectionSettings
) -> tuple[list[Judged], list[Excerpt], list[Mistake]]:
    """Agreements of every run as described, the excerpts with their mistakes taken back, and all
    mistakes.
    """
    described, amended, found = [], [], list[Mistake]()
    for i, excerpt in enumerate(shown):
        progress(f"comparing the instruments of {excerpt.run.name}", 0.15 + 0.35 * i / len(shown))
        described.append(judged(excerpt))
        own, then = mistakes(excerpt, settings=settings.mistakes)
        amended.append(then.excerpt)
        found += own
    return described, amended, found


def _fitted(
    experiment: Experiment,
    shown: Sequence[Excerpt],
    wrong: bool,
    contacts: Sequence[Contact],
    progress: Progress,
    settings: InspectionSettings,
) -> tuple[list[Delay], Posterior | None, list[str]]:
    """Delays, a fit of everything, and what to say of it."""
    if not experiment.runs:
        count = sum(len(each.frequency) for each in experiment.frequencies)
        rows = len(experiment.frequencies)
        return (
            [],
            None,
            [f"{count} natural frequencies in {rows} rows, and no recording to look at"],
        )
    if wrong:
        wait = "contacts, delays and identifiability are evaluated once the mistakes are corrected"
        return [], None, [wait]
    delays: list[Delay] = []
    moving = [run for run in experiment.runs if not run.static]
    touched = {contact.run for contact in contacts}
    clean = [p for p in shown if p.run.name not in touched] or list(shown)
    few = [p for p in clean if not p.static][: settings.fitted] + [p for p in clean if p.static]
    progress("fitting everything at once", 0.55)
    part = part_of(experiment, few, settings)
    joint, remarks = _joint(
        part, lambda what, done: progress(what, 0.55 + 0.35 * done), settings.fit
    )
    trusted = joint is not None and joint.fit.converged and experiment.robot.m > 0
    fitted = {p.run.name for p in few} if trusted else set[str]()
    progress("delays", 0.92)
    for run in moving[: settings.runs]:
        if joint is not None and run.name in fitted:
            delays += of_joint(joint, run.name, settings.delays)
        else:
            delays += of_excerpt(experiment, run, settings.delays, settings.agreements)
    late = [each.remark for each in delays if each.is_surprising(settings.delays)]
    return delays, joint, remarks + late


def _joint(
    part: Experiment, progress: Progress, settings: FitSettings
) -> tuple[Posterior | None, list[str]]:
    """A fit of everything and remarks on it; None where there is none."""
    try:
        joint = fit_jointly(centred(part), progress, settings=settings)
    except (NoBalanceError, InputError) as error:
        return None, [f"identifiability was not evaluated: {error}"]
    if joint.fit.converged:
        return joint, list(joint.notes)
    rough = "the fit of everything at once did not converge: its figures are rough"
    return joint, [*joint.notes, rough]


def _unexplained(described: Sequence[Judged]) -> str:
    """Where instruments contradict each other and no simple mistake explains it."""
    run, worst = max(
        ((j.excerpt.run.name, a) for j in described for a in j.bad), key=lambda pair: pair[1].worst
    )
    i = int(np.argmax(worst.ratio))
    return (
        f"run '{run}': {worst.name}: {worst.channels[i]} is off by {worst.ratio[i]:.2g} times what"
        " is allowed, and no simple mistake explains it; look at these instruments and the"
        " geometry of the robot"
    )
