"""Forces that balance a moving body exactly, along a motion, with systematic errors that are not zero."""

from dataclasses import replace

import numpy as np
from simulated import BODY, EXACT, ROBOT

from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.surroundings import Surroundings
from steelyard.identification.model.balance import (
    UNMODELLED_PARTS,
    Forces,
    balance_of,
)
from steelyard.identification.model.calibration_parameters import (
    CalibrationValues,
    gather,
)
from steelyard.identification.model.calibration_parameters.keys import APPARENT
from steelyard.identification.model.force_residuals import (
    whitened_balance,
)
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.processes import Process, integrals_of, named
from steelyard.identification.model.segment import POSE
from steelyard.identification.tally import Tally
from steelyard.instruments import Attitude, Tension, Wrench
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.instruments.tension import PRESLIDING, PRESLIDING_START
from steelyard.robot.model import Robot
from steelyard.smoothing import DEGREE, knots

START, END, SPACING = 0.2, 3.0, 0.4  # [s]
GRID = knots(START, END, SPACING)
STEP = 1e-5  # of central differences, of a coefficient, a parameter in its size, a systematic error
ROLLERS = frozenset({PRESLIDING, PRESLIDING_START})
DIFFERENCES = 2e-6  # relative to the largest; what curves over a metre, a second, a radian, in wrenches of a kN
BALANCED = 1e-8  # [N], [N m]; rounding of sums of forces of a kN
CONSTRAINED = 1e-5  # in 1-sigma; where SciPy's general solver ends
RARE = 1e-4  # of sound data that would fail

POINTS = replace(
    ROBOT, name="points", pulley_radius=np.zeros(8)
)  # cables leave from points: directions in one line
BARE = Robot("sensor", np.zeros((0, 3)), np.zeros((0, 3)))
SURROUNDINGS = ("attached", "drag", "damping", "bending")  # what pulls beside the cables, or bends
OUTSIDE = 41  # numbers that say so, the last ones
SIGMAS = np.array([3.0, 5.0, 4.0, 6.0, 5.0, 2.0, 5.0, 8.0])  # [N]
TENSION = {"kind": "tension", "clock": "recorder", "calibration": {"offset": 5.0}}
WRENCH = {
    "kind": "wrench",
    "clock": "recorder",
    "position": (0.02, -0.01, 0.1),
    "rpy_deg": (5, -10, 30),
    "calibration": {
        "offset": {"force": 5.0, "torque": 1.0},
        "position": 0.001,
        "misalignment": 0.01,
    },
}
FORCES = {
    "platform end": Tension.model_validate(TENSION),
    "winch end": Tension.model_validate({**TENSION, "end": "winch"}),
    "wrench": Wrench.model_validate(WRENCH),
    "wrench on the sensor": Wrench.model_validate({**WRENCH, "acts_on": "sensor"}),
}
HOSES = (
    {"at": (0.1, -0.2, 0.9), "to": (0.0, 3.0, 5.4), "force": 12.0, "stiffness": 12.0, "free": 1.5},
    {"at": (0.0, 0.3, -0.4), "to": (-2.0, 0.0, 0.5), "stiffness": 40.0, "free": 8.0},
)  # one that pulls, one that is slack
ATTITUDE = Attitude.model_validate({"kind": "attitude", "noise": 0.01})


class Case:
    """An arc, forces along it, a body, and systematic errors that are not zero; forces and motion
    balance exactly."""

    def __init__(
        self,
        force,
        robot=None,
        *,
        n=6,
        static=False,
        reference=None,
        disturbed=False,
        pulled=False,
        drifting=False,
        hoses=(),
        shared=False,
        loose=False,
        seed=7,
    ):
        rng = np.random.default_rng(seed)
        instrument = FORCES[force]
        self.robot = robot or (POINTS if instrument.kind == "tension" else BARE)
        attitude = ATTITUDE.model_copy(update={"clock": instrument.clock}) if shared else ATTITUDE
        suite = {"forces": instrument, "attitude": attitude}
        streams = {name: Stream(np.arange(3.0), {}, name) for name in suite}
        sync = dict.fromkeys(suite, 0.0)
        self.experiment = Experiment(
            "forces",
            self.robot,
            suite,
            (Run("run", streams, sync, static=static),),
            uncertainty=EXACT,
            loads=(Load("liquid", rigid=False),) if loose else (),
            surroundings=Surroundings.model_validate({"attached": hoses}),
        )
        self.calibration_parameters = gather(self.experiment)
        outside = [
            k for _, k, _ in self.calibration_parameters.places if k.startswith(SURROUNDINGS)
        ]
        count = len(self.calibration_parameters)
        drawn = rng.normal(size=count - (OUTSIDE if outside else 0))
        drawn = np.concatenate([drawn, np.random.default_rng(seed).normal(size=count - len(drawn))])
        values = self.calibration_parameters.mean + 0.01 * drawn
        for key, place in self.calibration_parameters.places.items():
            if key[1] == TIME_CONSTANT:
                values[place] = 0.0
            # How what bends follows the motion is of no account by the module's own word.
            absent = key[1] in {"viscous", "crosstalk"} or key[1].startswith("bending")
            if absent or (key[1].startswith(SURROUNDINGS) and not pulled):
                values[place] = 0.0
            if key[1] == PRESLIDING:
                values[place] = 0.1
            if key[1] == PRESLIDING_START:
                values[place] = 0.6 * drawn[place]
            if key[1].startswith(APPARENT):
                values[place] = 5 * drawn[place]
            if disturbed and "gain" in key[1]:
                # How an error of a gain changes the sight of an unmodelled wrench as the platform
                # moves is of no account.
                values[place] = 1.0
        self.calibration = CalibrationValues(self.calibration_parameters, values)
        if static:
            coefficients, self.time = somewhere(n, rng), np.arange(float(n))
        else:
            coefficients, self.time = (
                somewhere(len(GRID) - DEGREE - 1, rng),
                # So far apart that internal tensions are not smoothed.
                np.sort(np.linspace(0.5, 2.7, n) + rng.uniform(-0.08, 0.08, n)),
            )
        attitude = Reading(
            ("attitude", "orientation"), self.time, np.tile(np.eye(3), (n, 1, 1)), 1.0
        )
        grid = self.time if static else GRID
        self.segment = Segment(
            "run", grid, (attitude,), coefficients, static=static, reference=reference
        )
        if disturbed or drifting:
            processes = [
                Process(
                    source,
                    np.array([1.0, 2.0, 3.0]),
                    1.0,
                    0.5,
                    integrals_of(GRID),
                    upright=loose and part.start == 0,
                )
                for source, part in (UNMODELLED_PARTS.items() if disturbed else ())
            ]
            for quantity in instrument.quantities(self.robot.m) if drifting else ():
                sizes = 1 + 0.1 * np.arange(quantity.size)
                for cause in ("colored", "drift"):
                    source = named(("forces", quantity.name), cause)
                    processes.append(Process(source, sizes, 1.0, 0.5, integrals_of(GRID), cause))
            self.segment = self.segment.disturbed(tuple(processes))
            coefficients = self.segment.coefficients.copy()
            coefficients[:, POSE:] = 5 * rng.normal(size=coefficients[:, POSE:].shape)
            self.segment = replace(self.segment, coefficients=coefficients)
        self.parameters = BODY.parameters
        if self.robot.m:
            guess = {"tension": 700 + 150 * rng.normal(size=(n, self.robot.m))}
            sigma = SIGMAS
        else:
            guess = {"force": np.zeros((n, 3)), "torque": np.zeros((n, 3))}
            sigma = np.array([2.0, 3.0, 2.5, 0.1, 0.3, 0.2])
        self.forces = self.force_samples(guess, sigma)
        self.balanced()

    def balanced(self):
        """Move the readings as little as lets forces and motion balance."""
        # What is left over is linear in the readings of straight cables, and nearly so where they
        # sag.
        for _ in range(8):
            at = self.balance()
            off = np.einsum("nri,ni->nr", np.linalg.pinv(at.by_reading), at.left_over)
            self.forces = self.force_samples(self.changed(-off), self.forces.sigma)
        assert np.abs(self.balance().left_over).max() < BALANCED

    def force_samples(self, readings, sigma, left_out=None):
        n = len(self.time)
        none = np.zeros((n, len(sigma)), dtype=bool)
        return Forces(
            "forces",
            self.time,
            readings,
            sigma,
            none if left_out is None else left_out,
        )

    def changed(self, by):
        """Readings with something added, shape (n, r)."""
        ends = np.cumsum([v.shape[1] for v in self.forces.readings.values()])[:-1]
        parts = np.split(by, ends, axis=1)
        return {
            q: v + part for (q, v), part in zip(self.forces.readings.items(), parts, strict=True)
        }

    def balance(
        self, *, coefficients=None, values=None, parameters=None, forces=None, factors=None
    ):
        segment = (
            self.segment
            if coefficients is None
            else replace(self.segment, coefficients=coefficients)
        )
        calibration = (
            self.calibration
            if values is None
            else CalibrationValues(self.calibration_parameters, values)
        )
        own = self.parameters if parameters is None else parameters
        return balance_of(
            self.experiment, segment, forces or self.forces, calibration, own, factors or {}
        )

    def rows(self, *, forces=None, factors=None, tally=None):
        """With a border of the body and every systematic error."""
        columns = 10 + np.arange(len(self.calibration_parameters))
        return whitened_balance(
            self.experiment, self.segment, forces or self.forces, self.calibration, columns, self.parameters, factors or {},
            tally or Tally(),
        ).rows[0]  # fmt: skip

    def noisy(self, seed, size=1.0):
        rng = np.random.default_rng(seed)
        noise = size * rng.normal(size=self.forces.left_out.shape) * self.forces.sigma
        return replace(self.forces, readings=self.changed(noise))


def somewhere(count, rng):
    """Poses within the robot, about a metre and some tenths of a radian apart; quaternions of any
    length near one."""
    position = np.array([0.3, -0.2, 2.0]) + 0.2 * rng.normal(size=(count, 3))
    quaternion = np.array([1.05, 0.05, -0.05, 0.1]) + 0.05 * rng.normal(size=(count, 4))
    return np.hstack([position, quaternion])


def central_differences(function, x, directions):
    """Derivative along directions, shape (n, 6, directions)."""
    return np.stack(
        [(function(x + STEP * d) - function(x - STEP * d)) / (2 * STEP) for d in directions], axis=2
    )


def assert_derivatives(found, expected, off=DIFFERENCES):
    np.testing.assert_allclose(found, expected, atol=off * np.abs(expected).max())
