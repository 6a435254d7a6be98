"""From an identification to what a report shows of it: readings are thinned here, and nowhere
else.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.clocks.offsets import Offset
from steelyard.digits import number
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.experiment.model import Experiment
from steelyard.identification.identification import Identification
from steelyard.identification.methods.from_posterior.unstated import disturbances_along
from steelyard.identification.model.balance import UNMODELLED
from steelyard.identification.model.calibration_parameters import ROBOT, instruments_of
from steelyard.identification.residuals import Residuals, of_samples, residuals
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import BODY_PARAMETERS
from steelyard.inspection.swings import excited_modes, swing_spectrum
from steelyard.natural_frequencies.frequencies import frequencies
from steelyard.report.evidence.thinning import THINNING, Thinning, evenly, rounded
from steelyard.report.evidence.traces import traces
from steelyard.report.evidence.values import (
    CalibrationEstimate,
    ClockDelay,
    DirectedTest,
    DisturbanceTrack,
    EstimatedBody,
    Evidence,
    KnownCheck,
    MotionTrack,
    Noise,
    Number,
    RecordedRun,
    Shape,
    SwingTrack,
    UncertaintySource,
    UsedInstrument,
    numbers,
)
from steelyard.robot.model import Robot


def body_of(name: str, estimate: Estimate) -> EstimatedBody:
    """An estimate as plain values.

    Args:
        name: Heading of its column.
        estimate: With NaN where the data do not determine a parameter.
    """
    verdict = estimate.verdict
    return EstimatedBody(
        name,
        estimate.method,
        numbers(estimate.value),
        tuple(numbers(row) for row in estimate.covariance),
        tuple(verdict.parameters.get(each, "data") for each in BODY_PARAMETERS),
        verdict.accepted,
        verdict.reasons,
        verdict.disagreement,
        bool(estimate.details.get("moves_within")),
    )


def evidence_of(identification: Identification, thinning: Thinning = THINNING) -> Evidence:
    """What the estimate rests on, thinned for display.

    Args:
        identification: As :func:`steelyard.identification.identify.identify` gives it; one that
            does not know what it was made of has nothing to show.
        thinning: How much is kept.
    """
    experiment = identification.recorded
    if experiment is None:
        return Evidence()
    shown = replace(experiment, runs=experiment.runs[: thinning.most_runs])
    names = {run.name for run in shown.runs}
    estimate = identification.estimate
    posterior = identification.posterior
    samples = _placed(posterior) if posterior else _prepared(shown)
    motions: list[MotionTrack] = []
    for each in samples:
        if each.run in names:
            motions += _motion(each, thinning)
    found = _residuals(identification, names, samples)
    return Evidence(
        shape=shape_of(experiment.robot),
        motions=tuple(motions),
        traces=tuple(traces(found, thinning)),
        noise=tuple(_noise(experiment, estimate)),
        errors=tuple(_errors(posterior)) if posterior else (),
        tests=tuple(_tests(estimate)),
        clocks=tuple(_clocks(identification, posterior)) if posterior else (),
        contacts=tuple(_contacts(estimate)),
        disturbances=tuple(_disturbances(posterior, names, thinning)) if posterior else (),
        swings=tuple(_swings(shown, estimate, samples)),
        budget=tuple(_budget(estimate)),
        known=tuple(_known(estimate)),
        instruments=tuple(_instruments(experiment)),
        recorded=tuple(_recorded(experiment)),
        not_drawn=len(experiment.runs) - len(shown.runs),
    )


def _budget(estimate: Estimate) -> Iterator[UncertaintySource]:
    """What brings the variance of the ten."""
    for name, shares in estimate.details.get("uncertainty_budget", {}).items():
        yield UncertaintySource(name, numbers([shares[each] for each in BODY_PARAMETERS], 4))


def _known(estimate: Estimate) -> Iterator[KnownCheck]:
    """What was known beforehand against the readings, of all loads."""
    loads = {"": estimate} if estimate.loads is None else estimate.loads.estimates
    for load, each in loads.items():
        for found in each.details.get("known", {}).values():
            yield KnownCheck(load, **found)


def _instruments(experiment: Experiment) -> Iterator[UsedInstrument]:
    """Those that have recorded something."""
    for name, instrument in experiment.instruments.items():
        own = [run for run in experiment.runs if name in run.streams]
        if not own:
            continue
        rates = [
            (len(stream) - 1) / float(stream.time[-1] - stream.time[0])
            for run in own
            if not run.static
            and len(stream := run.streams[name]) > 1
            and stream.time[-1] > stream.time[0]
        ]
        count = sum(len(run.streams[name]) for run in own)
        rate = float(f"{np.median(rates):.4g}") if rates else None
        yield UsedInstrument(name, instrument.kind, count, rate)


def _recorded(experiment: Experiment) -> Iterator[RecordedRun]:
    """What was recorded, run by run."""
    for run in experiment.runs:
        load = experiment.load_of(run.name)
        spans = [np.ptp(each.time) for each in run.streams.values() if len(each)]
        duration = None if run.static or not spans else float(f"{max(spans):.4g}")
        yield RecordedRun(run.name, "" if load is None else load.name, run.static, duration)


def _swings(
    experiment: Experiment, estimate: Estimate, samples: Sequence[Samples]
) -> Iterator[SwingTrack]:
    """How the platform swings in runs with locked winches, and how the estimate would."""
    for run in experiment.runs:
        spectrum = swing_spectrum(experiment, run) if run.locked else None
        if spectrum is None:
            continue
        own = next((each for each in samples if each.run == run.name), None)
        hertz, amplitude = spectrum
        yield SwingTrack(
            run=run.name,
            frequency=tuple(rounded(hertz, 6)),
            amplitude=tuple(rounded(amplitude, 5)),
            seen=tuple((each.frequency, each.sigma) for each in excited_modes(experiment, run)),
            predicted=tuple(_predicted(experiment.robot, estimate, own)),
        )


def _predicted(
    robot: Robot, estimate: Estimate, samples: Samples | None
) -> Iterator[tuple[float, Number]]:
    """Natural frequencies of an estimate about the middle of a swing [Hz], with their 1-sigma."""
    if samples is None or samples.position is None or samples.rotation is None:
        return
    middle = Rotation.from_matrix(samples.rotation).mean().as_euler("ZYX")[::-1]
    try:
        found = frequencies(
            robot, estimate, pose=np.concatenate([samples.position.mean(axis=0), middle])
        )
    except InputError:
        # A body of which too little is told, or a pose in which a cable is hardly taut.
        return
    yield from ((each.frequency, each.standard_deviation) for each in found.modes)


def _disturbances(
    posterior: Posterior, runs: Collection[str], thinning: Thinning
) -> Iterator[DisturbanceTrack]:
    """What went on for a while beside the model, in the runs that are shown."""
    for each, times, values in disturbances_along(posterior):
        if each["run"] not in runs:
            continue
        few = evenly(len(times), thinning.most_instants)
        yield DisturbanceTrack(
            run=each["run"],
            owner=each["owner"],
            quantity=each["quantity"],
            cause=each["cause"],
            stated=each["stated"],
            unit=each["unit"],
            deviation=tuple(rounded(each["standard_deviation"], 6)),
            correlation_time=float(each["correlation_time"]),
            rms=tuple(rounded(each["root_mean_square"], 6)),
            time=tuple(rounded(times[few], 7)),
            values=tuple(tuple(rounded(column, 5)) for column in values[few].T),
        )


def _tests(estimate: Estimate) -> Iterator[DirectedTest]:
    for test in estimate.details.get("directed_tests", {}).get("largest", ()):
        yield DirectedTest(test["name"], test["z"], test["size"], test["unit"])


def _contacts(estimate: Estimate) -> Iterator[tuple[str, float, float]]:
    """Run, beginning and end [s] of what touched the platform."""
    for run, stretches in estimate.details.get("left_out", {}).get("contacts", {}).items():
        for start, end in stretches:
            yield run, float(start), float(end)


def _prepared(experiment: Experiment) -> list[Samples]:
    """Samples as the two steps take them, of the runs that have what they need."""
    found = []
    for run in experiment.runs:
        try:
            found.append(prepare(experiment, run, straight=True))
        except InputError:
            continue
    return found


def _placed(posterior: Posterior) -> list[Samples]:
    """Samples of a fit, with the place of the platform origin as it was stated."""
    origin = posterior.experiment.origin
    return [
        each
        if each.position is None or each.rotation is None
        else replace(each, position=each.position + each.rotation @ origin)
        for each in posterior.samples
    ]


def _residuals(
    identification: Identification, runs: Collection[str], samples: Sequence[Samples]
) -> Iterator[Residuals]:
    """Measured and predicted readings of every quantity, in the runs that are shown."""
    body = identification.estimate.body
    if identification.posterior:
        yield from residuals(identification.posterior, body, runs)
    elif body:
        for each in samples:
            yield from of_samples(each, body.parameters)


def shape_of(robot: Robot) -> Shape | None:
    """A robot as it is drawn; None without cables."""
    if not robot.m:
        return None
    return Shape(robot.name, _vectors(robot.anchors), _vectors(robot.attachments))


def _vectors(rows: Array) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)


def _motion(samples: Samples, thinning: Thinning) -> Iterator[MotionTrack]:
    """Where the platform was; nothing where no instrument measures it."""
    if samples.position is None or samples.rotation is None or not len(samples):
        return
    most = thinning.most_instants
    if not samples.static:
        length = float(samples.time[-1] - samples.time[0])
        most = min(most, max(2, int(length * thinning.instants_per_second)))
    few = evenly(len(samples), most)
    turned = Rotation.from_matrix(samples.rotation[few]).as_quat(scalar_first=True, canonical=True)
    x, y, z = (rounded(column, 6) for column in samples.position[few].T)
    q = [rounded(column, 6) for column in turned.T]
    yield MotionTrack(
        run=samples.run,
        static=samples.static,
        time=tuple(rounded(samples.time[few], 7)),
        position=tuple(zip(x, y, z, strict=True)),
        rotation=tuple(zip(q[0], q[1], q[2], q[3], strict=True)),
    )


def _noise(experiment: Experiment, estimate: Estimate) -> Iterator[Noise]:
    """Noise of every quantity, as it was stated, assumed and estimated."""
    for name, quantities in estimate.details.get("noise", {}).items():
        # What is of no instrument is the white part of the unmodelled wrench, told by its force.
        units = (
            {UNMODELLED: "N"}
            if name == ROBOT
            else {
                q.name: "rad" if q.rotation else q.unit
                for q in experiment.instruments[name].quantities(experiment.robot.m)
            }
        )
        for quantity, found in quantities.items():
            unit = next((u for key, u in units.items() if quantity.startswith(key)), "")
            levels = [_number(found[key]) for key in ("stated", "used", "found")]
            yield Noise(name, quantity, unit, *levels)


def _number(value: float | None) -> Number:
    return None if value is None or not np.isfinite(value) else float(value)


def _errors(posterior: Posterior) -> Iterator[CalibrationEstimate]:
    """Calibration parameters of the instruments that were not known exactly, but for clocks."""
    parameters, deviations = posterior.calibration.calibration_parameters, posterior.deviations
    for (place, unknown, _), name in zip(parameters.components(), parameters.names, strict=True):
        prior = float(parameters.deviation[place])
        if not prior or unknown.key == "delay" or unknown.owner == ROBOT:
            continue
        yield CalibrationEstimate(
            unknown.owner,
            name.removeprefix(f"{unknown.owner}."),
            unknown.unit,
            float(posterior.calibration.values[place]),
            float(deviations[place]),
            float(parameters.mean[place]),
            prior,
        )


def _clocks(identification: Identification, posterior: Posterior) -> Iterator[ClockDelay]:
    """Delays of all clocks, those of the instruments that share one together."""
    experiment, deviations = posterior.experiment, posterior.deviations
    parameters = posterior.calibration.calibration_parameters
    for place, unknown, _ in parameters.components():
        if unknown.key != "delay" or unknown.run is None:
            continue
        own = instruments_of(experiment, unknown)
        prior = float(parameters.deviation[place])
        yield ClockDelay(
            unknown.run,
            ", ".join(own),
            float(posterior.calibration.values[place]),
            float(deviations[place]) if prior else 0.0,
            prior,
            _found(identification.clocks, unknown.run, own),
        )


def offset_in_words(clock: Offset) -> str:
    """How late a clock is."""
    return f"{number(clock.value, clock.sigma, sign=True)} s"


def _found(clocks: Mapping[str, tuple[Offset, ...]], run: str, instruments: Sequence[str]) -> str:
    """How far a clock was found to be from that of the forces before the fit."""
    for each in clocks.get(run, ()):
        if set(each.instruments) & set(instruments):
            return offset_in_words(each)
    return ""
