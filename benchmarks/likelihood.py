"""Maximum likelihood under disturbances, from far-off beginnings, over long recordings, and beside
a general solver.

`python benchmarks/likelihood.py NAME`, with one of the names in the table at the end; `robust 20`
for 20 recordings.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from hour import ExactMotionOnCables, Repeated
from numpy.typing import NDArray
from recordings import recordings
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from verdicts import Recorder, with_stream

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, nothing_told
from steelyard.experiment.model import Experiment, Run
from steelyard.experiment.read import read_experiment
from steelyard.experiment.write import write_experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.model.force_residuals import BALANCE, force_residuals
from steelyard.identification.model.motion_residuals import (
    PARTS,
    Segment,
    Tally,
    limit,
    motion_residuals,
)
from steelyard.identification.model.segment import POSE, Rows, basis
from steelyard.identification.solve import joint_study as study_module
from steelyard.identification.solve.classical import NoBalanceError
from steelyard.identification.solve.joint_fit import Fit, State, Task, fit
from steelyard.identification.solve.joint_study import Joint, joint_study
from steelyard.identification.solve.normal_equations import TEN
from steelyard.inertia import BODY_PARAMETERS, LINEAR_PARAMETERS, Inertia
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import ExactMotion
from steelyard.simulation.sensors import draw_errors, paper_sensors, record
from steelyard.simulation.trajectories import feasible_multisine
from steelyard.smoothing import DEGREE

UNITS = np.array([1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1])

# Disturbed recordings

FIRST_SEED = 300_000
"""Apart from the seeds of every test and of the other benchmarks."""
SPIKES = 150.0, 600.0
"""[N]"""
HOLE = 1.7
"""[s]"""


def spiked(
    experiment: Experiment, rng: np.random.Generator, *, every_reading: bool
) -> tuple[Experiment, Array]:
    """The recording with spikes in 1 % of the samples (in one cable of each) or of all readings;
    and where, shape (n, m)."""
    shape = experiment.runs[0].streams["cables"].values["tension"].shape
    where = rng.random(shape) < 0.01
    if not every_reading:
        where = np.zeros(shape, dtype=bool)
        hit = np.flatnonzero(rng.random(shape[0]) < 0.01)
        where[hit, rng.integers(shape[1], size=len(hit))] = True
    spikes = rng.uniform(*SPIKES, shape) * rng.choice([-1.0, 1.0], shape) * where
    return (
        with_stream(experiment, "cables", lambda values: {"tension": values["tension"] + spikes}),
        where,
    )


def with_hole(experiment: Experiment, rng: np.random.Generator) -> Experiment:
    """The recording without what the tracker saw during a stretch somewhere."""
    run = experiment.runs[0]
    stream = run.streams["tracker"]
    start = rng.uniform(stream.time[0] + 0.5, stream.time[-1] - HOLE - 0.5)
    use = (stream.time < start) | (stream.time > start + HOLE)
    seen = replace(
        stream, time=stream.time[use], values={k: v[use] for k, v in stream.values.items()}
    )
    return replace(experiment, runs=(replace(run, streams={**run.streams, "tracker": seen}),))


def estimated(experiment: Experiment) -> tuple[Estimate, Joint | None]:
    """Estimate, and the fit it stands on where there is one."""
    try:
        joint = joint_study(experiment)
    except NoBalanceError as error:
        return nothing_told(MaximumLikelihood.name, str(error)), None
    return MaximumLikelihood().of(joint), joint


def left_out(experiment: Experiment, joint: Joint | None) -> NDArray[np.bool_]:
    """Which force readings were left out, shape (n, m)."""
    run = experiment.runs[0]
    time = experiment.common_time(run, "cables", 0.0)
    found = np.zeros((len(time), experiment.robot.m), dtype=bool)
    for force_samples in joint.force_samples if joint else ():
        found[np.searchsorted(time, force_samples.time)] |= force_samples.left_out
    return found


def robust(count: int = 12) -> None:
    """Errors with spikes and a hole in the tracker's stream, beside those of the same recordings
    without."""
    recorder = Recorder()
    truth = recorder.robot.platform.body_parameters
    # Whether every reading may spike, or one a sample; None: as recorded.
    kinds = {"clean": None, "one cable in 1 % of the samples": False, "1 % of all readings": True}
    found: dict[str, list[Estimate]] = {kind: [] for kind in kinds}
    counts: dict[str, list[Array]] = {kind: [] for kind in kinds}
    reasons: list[str] = []
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        sound = recorder(seed)
        for kind, every_reading in kinds.items():
            experiment, where = (
                sound,
                np.zeros((len(sound.runs[0].streams["cables"]), sound.robot.m), dtype=bool),
            )
            if every_reading is not None:
                rng = np.random.default_rng([seed, every_reading])
                experiment, where = spiked(sound, rng, every_reading=every_reading)
                experiment = with_hole(experiment, rng)
            estimate, joint = estimated(experiment)
            found[kind].append(estimate)
            out = left_out(experiment, joint)
            counts[kind].append(
                np.array([where.sum(), (where & out).sum(), (~where).sum(), (out & ~where).sum()])
            )
            if not estimate.verdict.accepted:
                reasons.append(
                    f"  rejected: seed {seed}, {kind}: {estimate.verdict.reasons[0][:150]}"
                )
    print(
        f"{count} recordings: CoGiRo, 20 s, sensors of the paper; spikes of {SPIKES[0]:.0f} to"
        f" {SPIKES[1]:.0f} N, hole of {HOLE} s; [kg], [mm], [kg m^2]"
    )
    print(f"{'':40}" + "".join(f"{name:>9}" for name in BODY_PARAMETERS) + "   pooled")
    errors = {kind: np.array([e.value - truth for e in each]) for kind, each in found.items()}
    told = np.all([np.isfinite(each).all(axis=1) for each in errors.values()], axis=0)
    rmse = {kind: np.sqrt(np.mean(each[told] ** 2, axis=0)) for kind, each in errors.items()}
    for kind, each in found.items():
        ratio = rmse[kind] / rmse["clean"]
        chi = [chi_square(e, truth) / 10 for e in each]
        spikes, caught, sound_readings, lost = np.sum(counts[kind], axis=0)
        print(f"{kind + ': rmse':40}" + "".join(f"{v:9.3f}" for v in rmse[kind] * UNITS))
        pooled = np.sqrt(np.mean(ratio**2))
        print(
            f"{'  over that of clean':40}" + "".join(f"{v:9.3f}" for v in ratio) + f"{pooled:9.3f}"
        )
        print(
            f"  accepted {sum(e.verdict.accepted for e in each)} of {count}, chi-square of the ten"
            f" per degree of freedom {np.mean(chi):.2f}; left out {caught} of {spikes} spiked and"
            f" {lost} of {sound_readings} other readings",
            flush=True,
        )
    if not told.all():
        print(f"  {np.sum(~told)} recordings with a number unknown are in none of the ratios")
    print(*reasons, sep="\n")


def chi_square(estimate: Estimate, truth: Array) -> float:
    """Of the ten, or of those that are known."""
    known = np.isfinite(estimate.value)
    sigma = estimate.standard_deviation[known]
    scaled = (estimate.value - truth)[known] / sigma
    block = estimate.covariance[np.ix_(known, known)] / np.outer(sigma, sigma)
    return float(scaled @ np.linalg.pinv(block, hermitian=True) @ scaled)


# Descriptions that are far off

WRONG = 29.6
"""Chi-square of the ten that one sound estimate in a thousand exceeds."""
SAME = 0.1
"""Difference in 1-sigma up to which two answers are the same."""
FAR_OFF = {"mass": 9, "sync": 12, "axes": 12, "no nominal body": 3, "combined": 14}
"""Kind of mistake -> how many."""


def wrong_mass(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    factor = float(rng.choice([3.0, 1 / 3]))
    body = experiment.robot.platform
    heavier = Inertia(body.mass * factor, body.center_of_gravity, body.inertia)
    return (
        replace(experiment, robot=replace(experiment.robot, platform=heavier)),
        f"mass x {factor:.2f}",
    )


def wrong_sync(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    late = float(rng.uniform(-0.3, 0.3))
    runs = tuple(
        replace(run, sync={**run.sync, "tracker": run.sync["tracker"] + late})
        for run in experiment.runs
    )
    return replace(experiment, runs=runs), f"sync {late:+.3f} s"


def wrong_axes(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    imu = experiment.instruments["imu"]
    as_stated = Rotation.from_euler("ZYX", np.array(imu.rpy_deg)[::-1], degrees=True)
    turned = Rotation.from_rotvec(np.radians(20) * axis) * as_stated
    rpy = tuple(float(each) for each in turned.as_euler("ZYX", degrees=True)[::-1])
    instruments = {**experiment.instruments, "imu": imu.model_copy(update={"rpy_deg": rpy})}
    return replace(experiment, instruments=instruments), f"IMU 20 deg about {np.round(axis, 2)}"


def no_nominal(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    return replace(experiment, robot=replace(experiment.robot, platform=None)), "no nominal body"


def combined(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    """Two or three mistakes at once."""
    body = wrong_mass if rng.random() < 0.7 else no_nominal
    mistakes = [body, wrong_sync, wrong_axes]
    if rng.random() < 0.6:
        del mistakes[rng.integers(3)]
    words = []
    for mistake in mistakes:
        experiment, word = mistake(experiment, rng)
        words.append(word)
    return experiment, ", ".join(words)


MISTAKES: dict[str, Callable[[Experiment, np.random.Generator], tuple[Experiment, str]]] = {
    "mass": wrong_mass,
    "sync": wrong_sync,
    "axes": wrong_axes,
    "no nominal body": no_nominal,
    "combined": combined,
}
OUTCOMES = (
    "same, accepted",
    "same, rejected",
    "other, rejected",
    "other, accepted",
    "accepted WRONG",
    "crashed",
)


def starts() -> None:
    """Descriptions that are far off, beside the right one."""
    right: dict[str, tuple[Experiment, Array, Estimate]] = {}
    for name, path, truth in recordings():
        if name.startswith("points-"):
            read = read_experiment(path)
            # The files name no nominal body: the right description is that with the true one.
            experiment = replace(read, robot=replace(read.robot, platform=truth))
            estimate = MaximumLikelihood()(experiment)
            right[name] = experiment, truth.body_parameters, estimate
            print(
                f"{name}, right description:"
                f" {'accepted' if estimate.verdict.accepted else 'rejected'}, chi-square of the ten"
                f" against the truth {chi_square(estimate, truth.body_parameters):.1f}"
            )
    outcomes: dict[str, Counter[str]] = {kind: Counter() for kind in MISTAKES}
    print(
        f"\n{'':9} {'recording':11}{'outcome':17}{'off [sigma]':>12}{'chi2':>8}  mistake; first"
        " reason"
    )
    for i, kind in enumerate(kind for kind, count in FAR_OFF.items() for _ in range(count)):
        name = sorted(right)[i % len(right)]
        experiment, truth, reference = right[name]
        far_off, words = MISTAKES[kind](experiment, np.random.default_rng(FIRST_SEED + i))
        try:
            found = MaximumLikelihood()(far_off)
        except InputError as error:
            found = nothing_told(MaximumLikelihood.name, str(error))
        except Exception:
            traceback.print_exc(file=sys.stdout)
            outcomes[kind]["crashed"] += 1
            continue
        off = float(np.max(np.abs(found.value - reference.value) / reference.standard_deviation))
        chi, same = chi_square(found, truth), off < SAME
        outcome = (
            f"{'same' if same else 'other'}, {'accepted' if found.verdict.accepted else 'rejected'}"
        )
        if found.verdict.accepted and not same and chi > WRONG:
            outcome = "accepted WRONG"
        outcomes[kind][outcome] += 1
        reason = next(iter(found.verdict.reasons), "")[:90]
        print(
            f"{i:9} {name:11}{outcome:17}{off:12.3g}{chi:8.3g} "
            f" {words}{'; ' + reason if reason else ''}",
            flush=True,
        )
    print(f"\n{'mistake':18}" + "".join(f"{outcome:>17}" for outcome in OUTCOMES))
    for kind, own in outcomes.items():
        print(f"{kind:18}" + "".join(f"{own[outcome]:17}" for outcome in OUTCOMES))
    total = sum(outcomes.values(), Counter())
    print(f"{'all':18}" + "".join(f"{total[outcome]:17}" for outcome in OUTCOMES))
    print(f"accepted wrong: {total['accepted WRONG']} of {total.total()}   wanted 0")


# Long recordings

LENGTHS = (20.0, 60.0, 180.0, 600.0)
FAST = {"cables": 100.0, "imu": 100.0, "tracker": 238.0}
PAPER = {"cables": 25.0, "imu": 25.0, "tracker": 238.0}
REFERENCE = [
    sys.executable,
    "-c",
    "import casadi, numpy, polars, pydantic, scipy.interpolate, scipy.integrate",
]
LONGEST, LARGEST, EXPONENT = 90.0, 2048.0, 1.1
"""Limits for ten minutes [s], [MiB], and for the growth."""
WHOLE, SOLVER = 3.5, 1.0
"""Limits for 20 s with the rates of the paper [s]."""
TIMED = """
import os
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import time
from steelyard.cli import main
from steelyard.identification.solve import joint_study
spent, solve = [], joint_study.fit
def fit(*given):
    start = time.perf_counter()
    try:
        return solve(*given)
    finally:
        spent.append(time.perf_counter() - start)
joint_study.fit = fit
try:
    main()
finally:
    print("\\n" + str(sum(spent)))
"""
"""`steelyard` as it is, which says in the end how long its solver took [s]."""


def write_length(folder: Path, duration: float, rates: Mapping[str, float]) -> None:
    """Write a recording of a motion of 20 s again and again, followed exactly."""
    robot = read_robot("cogiro").with_straight_cables()
    suite = paper_sensors(robot).instruments
    instruments = {
        name: suite[name].model_copy(update={"rate": rate}) for name, rate in rates.items()
    }
    rng = np.random.default_rng(1)
    errors = draw_errors(instruments, robot.m, ["run"], rng)
    motion = ExactMotion(robot, robot.platform, Repeated(feasible_multisine(robot, 20.0), duration))
    streams, sync = record(
        ExactMotionOnCables(robot, motion), instruments, errors["run"], robot, motion, rng
    )
    folder.mkdir(parents=True)
    # Under a name of its own: the bundled robot has sagging cables.
    robot = replace(robot, name="cogiro-straight")
    write_experiment(
        Experiment("a long one", robot, instruments, (Run("run", streams, sync),)), folder
    )


@dataclass(frozen=True)
class Taken:
    """What a whole process took."""

    wall: float
    """[s]"""
    solver: float
    """[s]"""
    peak: float
    """[MiB]"""
    output: str


def taken(command: list[str], folder: Path) -> Taken:
    """Run a command that says in its last line how long its solver took."""
    with (folder / "output").open("w+") as output:
        start = time.perf_counter()
        child = subprocess.Popen(command, stdout=output)
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        *lines, solver = output.read().splitlines()
    # 3: the estimate was made but not accepted.
    if child.returncode not in {0, 3}:
        raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}")
    return Taken(wall, float(solver), usage.ru_maxrss / 1024, "\n".join(lines))


def lengths() -> None:
    """Time and memory of `steelyard identify` by the length of the recording."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        reference = statistics.median(_bare_import() for _ in range(3))
        print(f"{'bare import of the libraries':44}{reference:8.2f} s")
        print(
            f"{'recording, method':44}{'whole':>10}{'over bare':>11}{'solver':>10}{'peak':>12} "
            " fits"
        )
        default = _shown(folder, 20.0, PAPER, [], reference, repeat=3)
        print(f"{'  limits':44}{WHOLE:8.2f} s{'':11}{SOLVER:8.2f} s")
        _shown(folder, 20.0, PAPER, ["--method", "maximum-likelihood"], reference, repeat=3)
        by_length = {
            length: _shown(
                folder,
                length,
                FAST,
                ["--method", "maximum-likelihood"],
                reference,
                repeat=3 if length < 100 else 1,
            )
            for length in LENGTHS
        }
        print(f"{'  limits for 600 s':44}{LONGEST:8.2f} s{'':21}{LARGEST:8.0f} MiB")
        long = [length for length in LENGTHS if length >= 60]
        growth = {
            what: float(
                np.polyfit(
                    np.log(long), np.log([getattr(by_length[each], what) for each in long]), 1
                )[0]
            )
            for what in ("wall", "solver", "peak")
        }
        print(
            f"exponent of growth from 60 to 600 s: whole process {growth['wall']:.2f}, solver"
            f" {growth['solver']:.2f}, memory {growth['peak']:.2f}   limit {EXPONENT}"
        )
        last = by_length[LENGTHS[-1]]
        kept = {
            "20 s whole": default.wall < WHOLE,
            "20 s solver": default.solver < SOLVER,
            "600 s whole": last.wall < LONGEST,
            "600 s memory": last.peak < LARGEST,
            "growth": growth["wall"] < EXPONENT,
        }
        print(", ".join(f"{what}: {'within' if each else 'BEYOND'}" for what, each in kept.items()))


def _bare_import() -> float:
    start = time.perf_counter()
    subprocess.run(REFERENCE, check=True)
    return time.perf_counter() - start


def _shown(
    folder: Path,
    length: float,
    rates: Mapping[str, float],
    options: list[str],
    reference: float,
    *,
    repeat: int,
) -> Taken:
    """Median by wall time of several runs, printed."""
    place = folder / f"{length:.0f}-{rates['cables']:.0f}"
    if not place.exists():
        # In a process of its own: what this one holds would count as the memory of its children.
        writer = get_context("spawn").Process(target=write_length, args=(place, length, rates))
        writer.start()
        writer.join()
    command = [
        sys.executable,
        "-c",
        TIMED,
        "identify",
        str(place / "experiment.yaml"),
        *options,
        "--quiet",
        "--json",
    ]
    one = sorted((taken(command, folder) for _ in range(repeat)), key=lambda each: each.wall)[
        repeat // 2
    ]
    found = json.loads(one.output)["estimates"]["maximum-likelihood"]
    what = (
        f"{length:.0f} s at {', '.join(f'{rate:.0f}' for rate in rates.values())} Hz,"
        f" {'ML' if options else 'default'}"
    )
    solver = found["details"]["solver"]
    verdict = (
        "accepted"
        if found["verdict"]["accepted"]
        else f"rejected: {found['verdict']['reasons'][0][:90]}"
    )
    print(
        f"{what:44}{one.wall:8.2f} s{one.wall / reference:9.1f} x{one.solver:8.2f} s{one.peak:8.0f}"
        f" MiB  {solver['steps']} steps in the last,"
        f" {'' if solver['converged'] else 'not '}converged, {verdict}",
        flush=True,
    )
    return one


# A general solver

PATIENCE = 300.0
"""[s]"""
MOST = 200
"""Evaluations."""
ARRIVED = 0.5
"""Excess of a chi-square over its least at which a solver has arrived: where the package's
stops."""


class LateError(Exception):
    """It takes too long."""


@dataclass
class Residuals:
    """The joint problem as residuals of all coefficients of the motion, the ten and the systematic
    errors.

    Noise and smoothness are held at what the state has. Huber's cost is that of a residual of
    length sqrt(2 c r - c^2).
    """

    task: Task
    state: State
    began: float = field(default_factory=time.perf_counter)
    trace: list[tuple[float, float, Array]] = field(default_factory=list)
    """Time [s], chi-square and point of every evaluation."""
    _last: tuple[Array, Array, sp.csr_matrix] | None = None

    def __post_init__(self) -> None:
        counts = [segment.coefficients.size for segment in self.state.segments]
        self.origins = np.concatenate([[0], np.cumsum(counts)])
        self.motion = int(self.origins[-1])
        self.columns = np.where(self.task.active, TEN + np.cumsum(self.task.active) - 1, -1)
        self.size = self.motion + TEN + int(self.task.active.sum())

    def point(self, state: State) -> Array:
        """Where a state stands, shape (N,)."""
        motion = [segment.coefficients.ravel() for segment in state.segments]
        return np.concatenate(
            [*motion, state.parameters, state.calibration.values[self.task.active]]
        )

    def at(self, point: Array) -> State:
        """The state at a point."""
        values = self.state.calibration.values.copy()
        values[self.task.active] = point[self.motion + TEN :]
        segments = tuple(
            replace(segment, coefficients=point[first:last].reshape(-1, POSE))
            for segment, first, last in zip(
                self.state.segments, self.origins[:-1], self.origins[1:], strict=True
            )
        )
        return replace(
            self.state,
            segments=segments,
            calibration=replace(self.state.calibration, values=values),
            parameters=point[self.motion : self.motion + TEN],
        )

    def residual(self, point: Array) -> Array:
        """Whitened, shape (M,)."""
        if time.perf_counter() - self.began > PATIENCE:
            raise LateError
        found = self._evaluated(point)[1]
        self.trace.append((time.perf_counter() - self.began, float(found @ found), point.copy()))
        return found

    def jacobian(self, point: Array) -> sp.csr_matrix:
        """Of the residuals, shape (M, N)."""
        return self._evaluated(point)[2]

    def _evaluated(self, point: Array) -> tuple[Array, Array, sp.csr_matrix]:
        if self._last is None or not np.array_equal(self._last[0], point):
            parts = list(self._parts(self.at(point)))
            residual = np.concatenate([part for part, _ in parts])
            self._last = (
                point.copy(),
                residual,
                sp.vstack([matrix for _, matrix in parts], format="csr"),
            )
        return self._last

    def _parts(self, state: State) -> Iterator[tuple[Array, sp.csr_matrix]]:
        task = self.task
        for segment, force_samples, origin in zip(
            state.segments, task.force_samples, self.origins[:-1], strict=True
        ):
            grouped = {
                segment.label(*each.source): 3 for each in segment.readings if each.values.ndim == 3
            }
            rows = motion_residuals(
                task.experiment, segment, state.calibration, self.columns, state.factors, Tally()
            )
            for part in rows:
                yield self._huber(part, int(origin), grouped.get(part.label, 1))
            given = (
                task.experiment,
                segment,
                force_samples,
                state.calibration,
                self.columns,
                state.parameters,
                state.factors,
                Tally(),
            )
            part = force_residuals(*given)
            assert part.label == segment.label(force_samples.name, BALANCE)
            yield self._huber(part, int(origin), part.residual.shape[1])
            stiff = self._smooth(segment, int(origin))
            yield stiff @ self.point(state), stiff
        deviation = task.calibration_parameters.deviation[task.active]
        off = (state.calibration.values - task.calibration_parameters.mean)[task.active] / deviation
        columns = self.motion + TEN + np.arange(len(off))
        yield (
            off,
            sp.csr_matrix(
                (1 / deviation, (np.arange(len(off)), columns)), shape=(len(off), self.size)
            ),
        )

    def _huber(self, rows: Rows, origin: int, together: int) -> tuple[Array, sp.csr_matrix]:
        """Residuals whose squares add up to Huber's cost; rows hold sqrt(w) r and sqrt(w) J, w = c
        / r where r > c."""
        residual = rows.residual
        size = (
            np.abs(residual)
            if together == 1
            else np.sqrt(np.sum(residual**2, axis=1, keepdims=True))
        )
        far = limit(together) / np.maximum(size, 1e-300)
        weight = np.ones_like(size) if rows.label is None else np.where(far < 1, far**2, 1.0)
        root = np.broadcast_to(np.sqrt(2 - weight), residual.shape)
        n, k, width = rows.by_motion.shape
        border = TEN + int(self.task.active.sum())
        named = np.arange(border) if rows.columns is None else rows.columns
        first = np.broadcast_to(
            (origin + POSE * rows.first)[:, None, None] + np.arange(width), (n, k, width)
        )
        last = np.broadcast_to(self.motion + named, (n, k, len(named)))
        values = np.concatenate([rows.by_motion, rows.by_errors], axis=2) / root[:, :, None]
        columns = np.concatenate([first, last], axis=2)
        starts = np.arange(n * k + 1) * columns.shape[2]
        matrix = sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(n * k, self.size))
        return (residual * root).ravel(), matrix

    def _smooth(self, segment: Segment, origin: int) -> sp.csr_matrix:
        """Third derivatives at the nodes of Gauss between knots, in 1-sigma of the white noise that
        they are."""
        inner = segment.knots[DEGREE : len(segment.knots) - DEGREE]
        nodes, weights = np.polynomial.legendre.leggauss(
            3
        )  # exact for squares of what is quadratic between knots
        half = np.diff(inner) / 2
        local = basis(
            segment.knots, (((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * nodes).ravel()
        )
        root = np.sqrt((half[:, None] * weights).ravel())
        intensity = np.ones(POSE)
        for part, place in PARTS.items():
            intensity[place] = segment.smoothness[part]
        values = (
            local.values[3][:, None, :] * root[:, None, None] / np.sqrt(intensity)[:, None]
        )  # (n, 7, 6)
        functions = local.first[:, None, None] + np.arange(DEGREE + 1)
        columns = np.broadcast_to(
            origin + POSE * functions + np.arange(POSE)[:, None], values.shape
        )
        starts = np.arange(values.shape[0] * POSE + 1) * (DEGREE + 1)
        shape = (values.shape[0] * POSE, self.size)
        return sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=shape)


def noticed(experiment: Experiment) -> list[tuple[Task, State, Fit]]:
    """Every fit that a study makes: what, from where, and where it ended."""
    fits: list[tuple[Task, State, Fit]] = []

    def noticing(task: Task, state: State, *tell: Callable[[float], None]) -> Fit:
        found = fit(task, state, *tell)
        fits.append((task, state, found))
        return found

    study_module.fit = noticing
    try:
        joint_study(experiment)
    finally:
        study_module.fit = fit
    return fits


def general() -> None:
    """The joint problem by scipy.optimize.least_squares, beside the package's own solver."""
    path = next(path for name, path, _ in recordings() if name == "points-00")
    fits = noticed(read_experiment(path))
    task, start, found = next(each for each in fits if each[1].parameters is not None)
    assert found is fits[-1][2], "points-00 has nothing to leave out"
    problem = Residuals(task, found.state)
    best, least = problem.point(found.state), found.tally.cost
    matrix = problem.jacobian(best)
    own = problem.residual(best)
    prior = (found.state.calibration.values - task.calibration_parameters.mean)[
        task.active
    ] / task.calibration_parameters.deviation[task.active]
    assert np.isclose(own @ own, least + prior @ prior, rtol=1e-9)
    print(
        f"points-00: {matrix.shape[0]} residuals, {matrix.shape[1]} unknowns ({problem.motion} of"
        f" the motion, {TEN} of the body, {int(task.active.sum())} errors), {matrix.nnz}"
        f" derivatives; chi-square {own @ own:.3f}"
    )
    # On the knots of the joint fit, which are told by the clock of the forces.
    begun = replace(
        start,
        segments=tuple(
            replace(segment, coefficients=first.coefficients)
            for segment, first in zip(start.segments, fits[0][1].segments, strict=True)
        ),
        calibration=fits[0][1].calibration,
    )
    given = {"from the motion's fit": start, "from the beginning": begun}
    sigma = np.sqrt(np.diag(found.covariance))
    print(
        f"{'solver':66}{'time':>10}{'ratio':>9}{'evaluations':>13}{'steps':>7}{'arrived':>11}{'chi2 over':>12}{'off: ten':>10}{'errors':>8}"
        "   (off: from the package's answer, in its 1-sigma)"
    )
    for words, beginning in given.items():
        seconds, ours = _median(lambda from_=beginning: fit(task, from_))
        _line(
            f"package, all of it, {words}",
            seconds,
            1.0,
            (ours.turns, ours.turns),
            None,
            problem,
            ours.state,
            best,
            sigma,
        )
        held = replace(
            beginning,
            factors=found.state.factors,
            segments=tuple(
                replace(a, smoothness=b.smoothness)
                for a, b in zip(beginning.segments, found.state.segments, strict=True)
            ),
        )
        given_noise, again = _median(lambda from_=held: fit(task, from_))
        _line(
            f"package, noise and smoothness as found, {words}", given_noise, given_noise / seconds, (again.turns, again.turns),
            None, problem, again.state, best, sigma,
        )  # fmt: skip
        _general(
            "scipy trf, lsmr, jac", problem, held, words, seconds, best, sigma, jac=problem.jacobian
        )
    pattern = matrix.copy()
    pattern.data[:] = 1.0
    words, beginning = next(iter(given.items()))
    _general(
        "scipy trf, lsmr, finite differences", problem, beginning, words, _median(lambda: fit(task, start))[0], best, sigma,
        jac="2-point", jac_sparsity=pattern,
    )  # fmt: skip
    print(
        "(scipy is given noise and smoothness, which the package finds; 'arrived': within a"
        f" chi-square of {ARRIVED} of the package's; each of its evaluations makes the derivatives"
        " too)"
    )


def _median(call: Callable[[], Fit]) -> tuple[float, Fit]:
    """Median time of three calls [s], and what the last gave."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        found = call()
        times.append(time.perf_counter() - start)
    return statistics.median(times), found


def _general(
    what: str,
    problem: Residuals,
    beginning: State,
    words: str,
    reference: float,
    best: Array,
    sigma: Array,
    **how: object,
) -> None:
    """Solve by SciPy and print how that went."""
    # A fresh one: nothing that is known from before.
    problem = Residuals(problem.task, problem.state)
    how = {**how, **({"jac": problem.jacobian} if callable(how["jac"]) else {})}
    try:
        solved = least_squares(
            problem.residual,
            problem.point(beginning),
            method="trf",
            tr_solver="lsmr",
            x_scale="jac",
            max_nfev=MOST,
            **how,
        )
        seconds, counts = time.perf_counter() - problem.began, (solved.nfev, solved.njev)
        end = problem.at(solved.x)
        note = (
            f"; ended: {solved.message}"
            if solved.status > 0
            else f"; did not arrive within {MOST} evaluations"
        )
    except LateError:
        seconds, counts = time.perf_counter() - problem.began, (len(problem.trace), None)
        end = problem.at(min(problem.trace, key=lambda each: each[1])[2])
        note = f"; did not arrive within {PATIENCE:.0f} s"
    _line(
        f"{what}, {words}",
        seconds,
        seconds / reference,
        counts,
        problem.trace,
        problem,
        end,
        best,
        sigma,
        note,
    )


def _line(
    what: str,
    seconds: float,
    ratio: float,
    counts: tuple[int, int | None],
    trace: list[tuple[float, float, Array]] | None,
    problem: Residuals,
    end: State,
    best: Array,
    sigma: Array,
    note: str = "",
) -> None:
    fresh = Residuals(problem.task, problem.state)
    point = fresh.point(end)
    least, reached = (float(np.sum(fresh.residual(each) ** 2)) for each in (best, point))
    arrived = next((at for at, cost, _ in trace or () if cost < least + ARRIVED), None)
    off = np.abs(point - best)[problem.motion :] / np.where(sigma > 0, sigma, np.inf)
    print(
        f"{what:66}{seconds:8.2f} s{ratio:8.1f}x{counts[0]:13}{counts[1] or '-':>7}"
        + (f"{arrived:9.2f} s" if arrived is not None else f"{'':11}")
        + f"{reached - least:12.4f}{off[:TEN].max():10.4f}{off[TEN:].max():8.4f}   "
        + f"worst {LINEAR_PARAMETERS[int(np.argmax(off[:TEN]))]}{note}",
        flush=True,
    )


BENCHMARKS: dict[str, Callable[..., None]] = {
    "robust": robust,
    "starts": starts,
    "lengths": lengths,
    "scipy": general,
}

if __name__ == "__main__":
    # A number says how many, to the name before it.
    names = [word for word in sys.argv[1:] if not word.isdigit()] or list(BENCHMARKS)
    many = {
        name: [int(word)]
        for name, word in zip(sys.argv[1:], sys.argv[2:], strict=False)
        if word.isdigit()
    }
    for chosen in names:
        print(f"\n== {chosen}")
        BENCHMARKS[chosen](*many.get(chosen, []))
