"""The Cramer-Rao bound against a dense Fisher matrix of readings predicted with NumPy, and against
estimates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation
from simulated import (
    BODY,
    CENTER,
    EXACT,
    IDEAL,
    REACH,
    RECORDER,
    ROBOT,
    at_rest,
    changed,
    pair,
    pair_studied,
    studied,
)

from steelyard.dynamics import platform_wrench
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues, gather
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.solve.bound import cramer_rao
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.inertia import BODY_PARAMETERS, Inertia, body_jacobian
from steelyard.instruments import Imu, Position, Tension
from steelyard.motion.trajectory import multisine
from steelyard.smoothing import DEGREE, knots

pytestmark = pytest.mark.integration

DIFFERENCES = (
    1e-4  # relative: central differences, and a Fisher matrix of a condition of many orders
)
LENGTH, SPACING = 4.0, 0.5  # [s]
POINTS = replace(
    ROBOT, name="points", pulley_radius=np.zeros(8)
)  # cables leave from points: directions in one line
NOISE = {"angular_velocity": 0.002, "specific_force": 0.03, "orientation": 0.003}
IMU_ERRORS = {
    "gyro_bias": 0.005,
    "accelerometer_bias": 0.05,
    "position": 0.004,
    "misalignment": 0.01,
    "reference": 0.003,
}
TRACKER_ERRORS = {"target": 0.003, "frame": {"position": 0.002, "rotation": 0.001}, "delay": 0.01}
CABLE_ERRORS = {"offset": 5.0, "gain": 0.01, "common_gain": 0.005}


def instruments(*, exact=False, tiny=False):
    """Of a small problem; with all systematic errors known exactly, or nearly so."""

    def sized(errors):
        if isinstance(errors, dict):
            return {key: sized(value) for key, value in errors.items()}
        return 0.0 if exact else errors * 1e-7 if tiny else errors

    return {
        "cables": Tension.model_validate(
            {
                "kind": "tension",
                "clock": "recorder",
                "noise": 5.0,
                "calibration": sized(CABLE_ERRORS),
            }
        ),
        "imu": Imu.model_validate(
            {
                "kind": "imu",
                "clock": "recorder",
                "position": (0.1, -0.05, 0.3),
                "noise": NOISE,
                "calibration": sized(IMU_ERRORS),
            }
        ),
        "tracker": Position.model_validate(
            {
                "kind": "position",
                "target": (0.1, 0.2, 1.1),
                "noise": 0.0005,
                "calibration": sized(TRACKER_ERRORS),
            }
        ),
    }


class Problem:
    """A short motion, its readings, and everything that is unknown about it as one vector."""

    def __init__(self, suite, uncertainty=EXACT):
        trajectory = multisine(list(CENTER), list(REACH), LENGTH, 3)
        self.knots = knots(0.0, LENGTH, SPACING)
        fine = np.linspace(0, LENGTH, 200)
        pose = trajectory.derivative(fine, 0)
        quaternion = Rotation.from_euler("ZYX", pose[:, :2:-1]).as_quat(scalar_first=True)
        design = BSpline.design_matrix(fine, self.knots, DEGREE).toarray()
        self.coefficients = np.linalg.lstsq(
            design, np.hstack([pose[:, :3], quaternion]), rcond=None
        )[0]
        rng = np.random.default_rng(0)
        self.times = {
            "imu": np.arange(0.01, LENGTH - 0.05, 0.06),
            "tracker": np.arange(0.02, LENGTH - 0.05, 0.05),
            "cables": np.arange(0.015, LENGTH - 0.05, 0.08),
        }
        # Tensions that balance, with an internal part that says nothing.
        p, R, omega, alpha, acceleration = self.motion(self.coefficients, self.times["cables"])
        s = np.einsum("nji,nj->ni", R, acceleration - ROBOT.gravity)
        W = self.structure(p, R, POINTS.anchors, POINTS.attachments)
        inner = 600 + 150 * rng.normal(size=(len(p), 8))
        missing = platform_wrench(BODY.parameters, s, omega, alpha) - np.einsum(
            "nkm,nm->nk", W, inner
        )
        self.tension = inner + np.einsum("nmk,nk->nm", np.linalg.pinv(W), missing)
        streams = {
            "cables": Stream(self.times["cables"], {"tension": self.tension}, "cables"),
            "imu": Stream(
                self.times["imu"],
                {key: np.zeros((len(self.times["imu"]), 3)) for key in NOISE},
                "imu",
            ),
            "tracker": Stream(
                self.times["tracker"],
                {"position": np.zeros((len(self.times["tracker"]), 3))},
                "tracker",
            ),
        }
        self.experiment = Experiment(
            "small",
            POINTS,
            suite,
            (Run("run", streams, dict.fromkeys(suite, 0.0)),),
            uncertainty=uncertainty,
        )
        self.calibration_parameters = gather(self.experiment)
        self.calibration = CalibrationValues(
            self.calibration_parameters, self.calibration_parameters.mean
        )
        self.active = self.calibration_parameters.deviation > 0

    # The same physics, written out once more

    def motion(self, coefficients, t):
        p, v, a = (BSpline(self.knots, coefficients, DEGREE)(t, nu=k) for k in range(3))
        q, dq, ddq = p[:, 3:], v[:, 3:], a[:, 3:]

        def product(x, y):
            w = x[:, 0] * y[:, 0] - np.sum(x[:, 1:] * y[:, 1:], axis=1)
            return np.column_stack(
                [w, x[:, :1] * y[:, 1:] + y[:, :1] * x[:, 1:] + np.cross(x[:, 1:], y[:, 1:])]
            )

        square = np.sum(q**2, axis=1, keepdims=True)
        inverse = q * [1, -1, -1, -1] / square
        omega = 2 * product(inverse, dq)
        # d/dt of q^-1 dq = q^-1 ddq - (q^-1 dq)^2
        alpha = 2 * (product(inverse, ddq) - product(omega / 2, omega / 2))
        R = Rotation.from_quat(q, scalar_first=True).as_matrix()
        return p[:, :3], R, omega[:, 1:], alpha[:, 1:], a[:, :3]

    def residuals(self, coefficients, parameters, errors):
        """All readings less what is measured, in their 1-sigma; rotations against those of the
        start."""
        e = {
            (u.owner, u.key): errors[self.calibration_parameters.places[u.owner, u.key, u.run]]
            for u in self.calibration_parameters.entries
        }
        gravity = e["robot", "gravity"]
        found = []
        _, R, omega, alpha, acceleration = self.motion(coefficients, self.times["imu"])
        turned = Rotation.from_rotvec(e["imu", "misalignment"]).as_matrix()
        place = np.array([0.1, -0.05, 0.3]) + e["imu", "position"]
        force_samples = np.einsum("nji,nj->ni", R, acceleration - gravity)
        force_samples = (
            force_samples + np.cross(alpha, place) + np.cross(omega, np.cross(omega, place))
        )
        found.append((omega @ turned + e["imu", "gyro_bias"]) / NOISE["angular_velocity"])
        found.append(
            (force_samples @ turned + e["imu", "accelerometer_bias"]) / NOISE["specific_force"]
        )
        attitude = Rotation.from_rotvec(e["imu", "reference"]).as_matrix().T @ R @ turned
        if not hasattr(self, "start"):
            self.start = attitude
        off = Rotation.from_matrix(self.start.transpose(0, 2, 1) @ attitude).as_rotvec()
        found.append(off / NOISE["orientation"])
        p, R, *_ = self.motion(coefficients, self.times["tracker"] - e["tracker", "delay"][0])
        target = p + R @ (np.array([0.1, 0.2, 1.1]) + e["tracker", "target"])
        frame = Rotation.from_rotvec(e["tracker", "frame.rotation"]).as_matrix()
        found.append((target - e["tracker", "frame.position"]) @ frame / 0.0005)
        # Forces: the wrench of the measured tensions less what moves the body, in the 1-sigma of
        # the wrench.
        p, R, omega, alpha, acceleration = self.motion(coefficients, self.times["cables"])
        tension = (self.tension - e["cables", "offset"]) / (
            e["cables", "gain"] * e["cables", "common_gain"]
        )
        W = self.structure(
            p, R, e["robot", "anchor"].reshape(-1, 3), e["robot", "attachment"].reshape(-1, 3)
        )
        if not hasattr(self, "white"):
            self.white = np.linalg.inv(np.linalg.cholesky(25.0 * W @ W.transpose(0, 2, 1)))
        body = Inertia.from_parameters(parameters)
        J, h, m = body.inertia_about_origin, body.first_moment, body.mass
        s = np.einsum("nji,nj->ni", R, acceleration - gravity)
        force = m * s + np.cross(alpha, h) + np.cross(omega, np.cross(omega, h))
        torque = np.cross(h, s) + alpha @ J + np.cross(omega, omega @ J)
        left = np.einsum("nkm,nm->nk", W, tension) - np.hstack([force, torque])
        found.append(np.einsum("nij,nj->ni", self.white, left))
        # The quaternion may have any length, which is held near one as the package does: to 1 % at
        # the knots and between them. That matters little (.2 %), but not nothing, since a spline of
        # unit length has fewer shapes.
        held = np.linspace(0, LENGTH, round(2 * LENGTH / SPACING) + 1)
        norm = np.sum(BSpline(self.knots, coefficients, DEGREE)(held)[:, 3:] ** 2, axis=1)
        found.append(norm[:, None] / 0.01)
        return np.concatenate([each.ravel() for each in found])

    @staticmethod
    def structure(p, R, anchors, attachments):
        corners = p[:, None] + np.einsum("nij,mj->nmi", R, attachments)
        line = anchors - corners
        pull = np.einsum("nji,nmj->nmi", R, line / np.linalg.norm(line, axis=2, keepdims=True))
        return np.concatenate([pull, np.cross(attachments, pull)], axis=2).transpose(0, 2, 1)

    def dense(self, known=None):
        """Covariance of the ten body parameters and of the errors that are not exact, by inverting
        everything at once."""
        x0 = np.concatenate(
            [self.coefficients.ravel(), BODY.parameters, self.calibration_parameters.mean]
        )
        count, columns = self.coefficients.size, []

        def at(x):
            return self.residuals(x[:count].reshape(-1, 7), x[count : count + 10], x[count + 10 :])

        at(x0)
        places = np.concatenate([np.arange(count + 10), count + 10 + np.flatnonzero(self.active)])
        sizes = np.concatenate(
            [
                np.full(count, 1e-5),
                1e-4 * np.maximum(np.abs(BODY.parameters), 1.0),
                np.full(self.active.sum(), 1e-5),
            ]
        )
        for place, size in zip(places, sizes, strict=True):
            step = np.zeros(len(x0))
            step[place] = size
            columns.append((at(x0 + step) - at(x0 - step)) / (2 * size))
        A = np.array(columns).T
        prior = np.zeros((int(self.active.sum()), A.shape[1]))
        prior[:, count + 10 :] = np.diag(1 / self.calibration_parameters.deviation[self.active])
        J = body_jacobian(BODY.parameters)
        rows = [A, prior]
        for name, sigma in (known or {}).items():
            row = np.zeros((1, A.shape[1]))
            row[0, count : count + 10] = J[BODY_PARAMETERS.index(name)] / sigma
            rows.append(row)
        stacked = np.vstack(rows)
        scale = np.linalg.norm(stacked, axis=0)
        # By orthogonal factors rather than normal equations, and without a Schur complement.
        upper = np.linalg.qr(stacked / scale, mode="r")
        inverse = np.linalg.inv(upper) / scale[:, None]
        covariance = inverse @ inverse.T
        return (
            J @ covariance[count : count + 10, count : count + 10] @ J.T,
            covariance[count + 10 :, count + 10 :],
        )

    def bound(self, *, left_out=(), known=None, finer=1.0):
        """The bound by the package, of some of the readings."""
        readings = []
        _, R, *_ = self.motion(self.coefficients, self.times["imu"])
        self.residuals(self.coefficients, BODY.parameters, self.calibration_parameters.mean)
        for name, sigmas in (("imu", NOISE), ("tracker", {"position": 0.0005})):
            for quantity, sigma in sigmas.items():
                if (name, quantity) in left_out:
                    continue
                n = len(self.times[name])
                values = R if quantity == "orientation" else self.exact(name, quantity)
                assert len(values) == n
                readings.append(Reading((name, quantity), self.times[name], values, sigma / finer))
        segment = Segment("run", self.knots, tuple(readings), self.coefficients)
        n = len(self.tension)
        forces = Forces(
            "cables",
            self.times["cables"],
            {"tension": self.tension},
            np.full(8, 5.0 / finer),
            np.zeros((n, 8), dtype=bool),
        )
        return cramer_rao(
            self.experiment,
            self.calibration,
            {"run": (segment,)},
            {"run": (forces,)},
            BODY.parameters,
            known=known,
        )

    def exact(self, name, quantity):
        """Readings without noise, since those that stand far count less."""
        _, R, omega, alpha, acceleration = self.motion(self.coefficients, self.times["imu"])
        if quantity == "angular_velocity":
            return omega
        if quantity == "specific_force":
            place = np.array([0.1, -0.05, 0.3])
            force_samples = np.einsum("nji,nj->ni", R, acceleration - ROBOT.gravity)
            return force_samples + np.cross(alpha, place) + np.cross(omega, np.cross(omega, place))
        p, R, *_ = self.motion(self.coefficients, self.times["tracker"])
        return p + R @ np.array([0.1, 0.2, 1.1])


UNSURE = {"anchor": 0.003, "attachment": 0.002, "gravity": 0.002}


def assert_covariances(found, expected, relative):
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.sqrt(np.diag(found)), scale, rtol=relative)
    np.testing.assert_allclose(
        found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=5 * relative
    )


@pytest.mark.parametrize(
    "uncertainty", [EXACT, UNSURE], ids=["geometry exact", "geometry uncertain"]
)
def test_the_bound_is_that_of_the_dense_fisher_matrix(uncertainty):
    problem = Problem(instruments(), uncertainty)
    found = problem.bound()
    body, errors = problem.dense()
    assert_covariances(found.covariance, body, DIFFERENCES)
    own = found.calibration[np.ix_(problem.active, problem.active)]
    assert_covariances(own, errors, DIFFERENCES)
    np.testing.assert_array_equal(found.calibration[~problem.active], 0.0)


def test_what_is_known_about_the_body_counts_as_a_reading_of_it():
    problem = Problem(instruments())
    found = problem.bound(known={"mass": (BODY.mass, 0.02), "cz": (0.0, 1e-4)})
    body, _ = problem.dense({"mass": 0.02, "cz": 1e-4})
    assert_covariances(found.covariance, body, DIFFERENCES)
    assert found.standard_deviation[0] <= 0.02


def test_errors_known_exactly_are_errors_known_nearly_exactly():
    exact, nearly = (Problem(instruments(exact=e, tiny=not e)) for e in (True, False))
    assert not exact.active.any()
    assert nearly.active.sum() > 30
    np.testing.assert_allclose(
        exact.bound().standard_deviation, nearly.bound().standard_deviation, rtol=1e-4
    )


def test_more_and_better_readings_tell_more():
    problem = Problem(instruments())
    everything = problem.bound()
    for source in (("imu", "angular_velocity"), ("imu", "specific_force"), ("imu", "orientation")):
        less = problem.bound(left_out={source})
        # As a matrix: no combination of parameters is known better with fewer instruments.
        scale = 1 / everything.standard_deviation
        difference = (less.covariance - everything.covariance) * np.outer(scale, scale)
        assert np.linalg.eigvalsh(difference).min() > -1e-6
        assert np.all(less.standard_deviation > everything.standard_deviation * (1 + 1e-9))
    exact = Problem(instruments(exact=True)).bound()
    assert np.all(exact.standard_deviation < everything.standard_deviation)
    # Without priors, half of the noise is half of the uncertainty, but for the length of the
    # quaternion.
    finer = Problem(instruments(exact=True)).bound(finer=2.0)
    np.testing.assert_allclose(finer.standard_deviation, exact.standard_deviation / 2, rtol=2e-3)


# Recorded experiments


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_estimate_is_surer_than_the_bound(seed):
    found = studied(seed)
    own, bound = LeastSquares().of(found), found.bound
    ratio = own.standard_deviation / bound.standard_deviation
    # The bound stands at the estimate, whose noise moves it; the filter and the weights cost the
    # rest.
    assert np.all(ratio > 0.97), ratio
    assert np.all(ratio < 1.4), ratio


@pytest.mark.slow
def test_ideal_sensors_leave_next_to_no_uncertainty():
    suite = {name: changed(each, rate=50.0) for name, each in IDEAL.items()}
    bound = fit_with_held_motion(RECORDER(0, instruments=suite)).bound
    # Readings of no noise count as no better than a thousandth of the largest.
    assert np.all(bound.standard_deviation < 0.1)


@pytest.mark.slow
def test_poses_at_rest_add_to_it():
    poses = CENTER + np.random.default_rng(1).uniform(-1, 1, (40, 6)) * REACH
    experiment = RECORDER(1)
    both = replace(experiment, runs=(*experiment.runs, at_rest(poses, RECORDER.drawn["run"])))
    alone, added = (
        fit_with_held_motion(experiment).bound,
        fit_with_held_motion(both).bound,
    )
    ratio = added.standard_deviation / alone.standard_deviation
    assert np.all(ratio < 1.02)
    assert ratio[3] < 0.98


@pytest.fixture(scope="module")
def runs():
    """Bounds of one run, of two, and of two of which the forces of the second are held out."""
    one = replace(pair(), runs=pair().runs[:1])
    studies = (
        fit_with_held_motion(one),
        pair_studied(),
        fit_with_held_motion(pair(), held_out=frozenset({"b"})),
    )
    return [found.bound.standard_deviation for found in studies]


def test_several_runs_tell_more_than_one(runs):
    one, two, _ = runs
    # No more than twice the information in what noise limits, and less where priors do; the filters
    # differ a little.
    assert np.all((two / one < 0.95) & (two / one > 0.63)), two / one


def test_held_out_runs_tell_nothing(runs):
    one, _, held = runs
    # Its motion still says something about the instruments; its forces do not.
    assert np.all((held / one < 1.1) & (held / one > 0.85)), held / one
