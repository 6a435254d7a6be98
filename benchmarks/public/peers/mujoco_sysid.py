"""MuJoCo's system identification toolbox: the platform as a free body that the measured wrench drives,
in windows of half a second whose initial states are measured."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid
from recording import Array, read_platform
from scipy.signal import butter, filtfilt

from peers.filtered import MARGIN

NAME = "MuJoCo sysid"
DATA = "platform"
WINDOW = 0.5
"""Over which errors of the wrench stay small when they are integrated [s]."""
CUT_OFF = 10.0
"""Of readings before they drive the model and begin windows [Hz]."""
THIN = 5
"""Of the samples every so many make residuals: behind the filter neighbours are alike."""
STEPS = 6
"""Of the optimiser, in each of two turns: before and after the residuals tell the noise."""
_AXES = "".join(
    f'<general site="origin" gear="{" ".join("1" if i == k else "0" for i in range(6))}"/>'
    for k in range(6)
)


def _spec(step: float, mass: float, c: Array, size: float) -> mujoco.MjSpec:
    inertia = mass * size**2
    return mujoco.MjSpec.from_string(f"""
        <mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 -9.81"/>
        <worldbody><body name="platform"><freejoint/>
        <inertial mass="{mass}" pos="{c[0]} {c[1]} {c[2]}" diaginertia="{inertia} {inertia} {inertia}"/>
        <site name="origin"/></body></worldbody>
        <actuator>{_AXES}</actuator>
        <sensor><gyro name="gyro" site="origin"/><accelerometer name="acc" site="origin"/></sensor>
        </mujoco>""")


def _put(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
    """A pseudo-inertia as principal moments; MuJoCo 4.0 refuses what the toolbox's own modifier
    writes for a body without shapes."""
    ten = sysid.model_modifier.pi_from_theta(parameter.value)
    center = ten[1:4] / ten[0]
    about = ten[4:].reshape(3, 3) - ten[0] * (
        center @ center * np.eye(3) - np.outer(center, center)
    )
    moments, axes = np.linalg.eigh(about)
    axes[:, 2] *= np.linalg.det(axes)
    body = spec.body("platform")
    body.mass, body.ipos, body.inertia = ten[0], center, moments
    body.fullinertia = np.full((6, 1), np.nan)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    body.iquat, body.explicitinertial = quaternion, True


def estimate(folder: Path) -> tuple[Array, Array]:
    """The ten by the toolbox's own optimiser over pseudo-inertias, and its covariance."""
    data = read_platform(folder)
    h = data.step
    b, a = butter(4, CUT_OFF, fs=1 / h)
    low = lambda each: filtfilt(b, a, each, axis=0)  # noqa: E731
    omega, force, wrench, q = map(
        low, (data.omega, data.specific_force, data.wrench, data.quaternion)
    )
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    mass = float(np.linalg.norm(wrench[:, :3].mean(axis=0)) / 9.81)
    # Half the size of the platform, from its description would do as well.
    size = max(0.05, 0.08 * mass ** (1 / 3))
    # Mass and centre of gravity to begin with: as if it were at rest.
    f, torque = wrench[:, :3], wrench[:, 3:]
    cross = np.array([[[0, z, -y], [-z, 0, x], [y, -x, 0]] for x, y, z in f])
    center = np.linalg.lstsq(cross.reshape(-1, 3), torque.ravel(), rcond=None)[0]
    spec = _spec(h, mass, center, size)
    model = spec.compile()
    long = round(WINDOW / h)
    starts = np.arange(round(MARGIN / h), len(data.t) - round(MARGIN / h) - long, long)
    states, controls, readings = [], [], []
    clock = np.arange(long + 1) * h
    for first in starts:
        part = slice(first, first + long + 1)
        pose = np.concatenate([np.zeros(3), q[first]])
        states.append(
            sysid.create_initial_state(model, pose, np.concatenate([np.zeros(3), omega[first]]))
        )
        controls.append(sysid.TimeSeries(clock, wrench[part]))
        read = np.hstack([omega[part], force[part]])
        readings.append(sysid.TimeSeries.from_names(clock, read, model))
    sequences = sysid.ModelSequences(
        "platform", spec, [f"window {i}" for i in range(len(starts))], states, controls, readings
    )
    parameters = sysid.ParameterDict()
    parameters.add(
        sysid.body_inertia_param(
            spec, model, "platform", sysid.InertiaType.Pseudo,
            stretch_bound_mult=np.array([0.01, 100.0]), shear_bound_off=np.array([-3.0, 3.0]),
            ipos_bound_off=np.array([-1.0, 1.0]), modifier=_put,
        )
    )  # fmt: skip
    sigma = np.array([0.02, 0.02, 0.02, 0.1, 0.1, 0.1])

    def residual(_, predicted, measured, *__, **___):
        # MuJoCo's sensors are those of the beginning of a step, and the first is the initial state;
        # one mapping for both, since the toolbox compares them as objects.
        kept = sysid.TimeSeries(measured.times[1:-1], measured.data[1:-1], predicted.signal_mapping)
        off = (predicted.data[1 : len(kept.data) + 1] - kept.data) / sigma
        return off[THIN - 1 :: THIN].ravel(), predicted, kept

    function = sysid.build_residual_fn(
        models_sequences=[sequences],
        modify_residual=residual,
        n_threads=1,
        resample_true=False,
    )
    parameters, _ = sysid.optimize(parameters, function, verbose=False, max_iters=STEPS)
    errors = function(parameters.as_vector(), parameters)[0]
    rows = np.concatenate([each.ravel() for each in errors]).reshape(-1, 6)
    sigma = sigma * rows.std(axis=0)
    parameters, found = sysid.optimize(parameters, function, verbose=False, max_iters=STEPS)
    errors = [each.ravel() for each in function(found.x, parameters)[0]]
    covariance, _ = sysid.calculate_intervals(errors, np.asarray(found.jac))
    body = lambda theta: _body(spec, parameters, theta)  # noqa: E731
    steps = 1e-5 * np.eye(10)
    jacobian = np.column_stack([(body(found.x + e) - body(found.x - e)) / 2e-5 for e in steps])
    return body(found.x), jacobian @ covariance @ jacobian.T


def _body(spec: mujoco.MjSpec, parameters: sysid.ParameterDict, theta: Array) -> Array:
    """Mass, centre of gravity and inertia about it of the toolbox's parameters."""
    parameters.update_from_vector(theta)
    model = sysid.apply_param_modifiers(parameters, spec)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body("platform").iquat)
    R = rotation.reshape(3, 3)
    J = R @ np.diag(model.body("platform").inertia) @ R.T
    ten = [J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]
    return np.concatenate([model.body("platform").mass, model.body("platform").ipos, ten])
