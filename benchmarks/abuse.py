"""Numbers far from those the package was made for: is any estimate accepted that is not true?

``python benchmarks/abuse.py [SECONDS [WORD ...]]``: bodies of 1 g to 100 t in frames of 2 cm to
1.5 km, 1 to 60 cables, 10 Hz to 10 kHz, noise stated 1e-9 to 100 times what it is, priors of 0 and
without end, by each method; with words only cases that name one of these (``m``, ``rate``).
Recordings are made by plain vector algebra of a rigid body on straight cables: of six and more it
follows a motion, on fewer it swings on elastic cables that are wound to and fro. An estimate that is
accepted with a squared error of more than four times its covariance for each parameter is printed
as WRONG.
"""

import sys
import time
import warnings
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import steelyard
from steelyard.errors import SteelyardError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.instruments import Imu, Position, Tension
from steelyard.robot.model import Robot

METHODS = (
    "two-step",
    "least-squares",
    "instrumental-variables",
    "consistent",
    "maximum-likelihood",
)
MOST = 4.0
"""Squared error over covariance, for each parameter."""
G = 9.81
BASE = {"mass": 100.0, "size": 15.0, "m": 8, "rate": 50.0, "stated": 1.0, "prior": 1.0}
CASES = [
    *({"mass": a, "size": b} for a, b in product((1e-3, 1.0, 1e5), (0.02, 15.0, 1500.0))),
    *({"m": m} for m in (1, 2, 3, 5, 6, 12, 24, 60)),
    *({"rate": rate} for rate in (10.0, 1000.0, 10_000.0)),
    *({"stated": factor} for factor in (1e-9, 1e-6, 1e-3, 0.1, 0.5, 2.0, 10.0, 100.0)),
    *({"prior": factor} for factor in (0.0, 0.1, 1e3, 1e9)),
    *({"delay": delay} for delay in (0.002, 0.01, 0.03)),
    *({"stated": a, "prior": b} for a, b in product((1e-6, 100.0), (0.0, 1e9))),
]
"""What differs from the first; ``prior``: of offsets, biases and misalignment, in units of what
they are drawn with; ``delay``: of the tracker, stated as none [s]."""


def motion(time, size, rng):
    """Place, rotation, and the derivatives that a rigid body needs, at times of shape (n,)."""
    frequency = rng.uniform(0.2, 0.9, (4, 6))
    phase = rng.uniform(0, 2 * np.pi, (4, 6))
    reach = np.concatenate([np.full(3, min(0.01 * size, 0.12)), np.full(3, 0.06)])

    def at(t):
        return (reach * np.sin(2 * np.pi * frequency * t[:, None, None] + phase)).sum(axis=1)

    w = 2 * np.pi * frequency
    angle = w * time[:, None, None] + phase
    acceleration = -(reach * w**2 * np.sin(angle)).sum(axis=1)[:, :3]
    pose, h = at(time), 1e-4
    before, after = (Rotation.from_rotvec(at(time + s)[:, 3:]) for s in (-h, h))
    here = Rotation.from_rotvec(pose[:, 3:])
    forth, back = (here.inv() * after).as_rotvec() / h, (before.inv() * here).as_rotvec() / h
    return pose[:, :3], here, (forth + back) / 2, (forth - back) / h, acceleration


def swinging(time, body, anchors, attachments, seed):
    """A body on fewer than six elastic cables: what :func:`motion` gives, and tensions, shape (n, m).

    It is pushed once it hangs at rest; the winches wind by one per cent of the lengths.
    """
    mass, cog, J = body
    J = J - mass * _matrix(cog) @ _matrix(cog)  # about the origin
    rng = np.random.default_rng([seed, 6])
    place = anchors.mean(axis=0) * [1, 1, 0]
    length = np.linalg.norm(anchors - attachments - place, axis=1)
    stretch = G / (2 * np.pi * 2.0) ** 2  # so that it bounces at 2 Hz
    stiffness = mass * G / (len(anchors) * stretch)
    beat, phase = rng.uniform(0.2, 0.6, len(anchors)), rng.uniform(0, 2 * np.pi, len(anchors))
    spatial = np.block([
        [mass * np.eye(3), -mass * _matrix(cog)], [mass * _matrix(cog), J]
    ])  # fmt: skip

    def forces(t, y, moving):
        here = Rotation.from_quat(y[3:7])
        along = anchors - y[:3] - here.apply(attachments)
        long = np.linalg.norm(along, axis=1)
        wound = length - stretch
        wound = wound + moving * 0.01 * length * (
            np.sin(2 * np.pi * beat * t + phase) - np.sin(phase)
        )
        tension = np.maximum(stiffness * (long - wound), 0.0)
        return here, along / long[:, None], tension

    def rate(t, y, moving):
        """Velocity of the origin in the world, angular velocity in the platform."""
        here, along, tension = forces(t, y, moving)
        omega, pull = y[10:], here.inv().apply(along * tension[:, None])
        v = here.inv().apply(y[7:10])
        weight = here.inv().apply([0.0, 0.0, -mass * G])
        damped = 0.0 if moving else 1.0
        force = pull.sum(axis=0) + weight - damped * mass * v
        torque = np.cross(attachments, pull).sum(axis=0) + np.cross(cog, weight)
        torque = torque - damped * J @ omega
        # Newton and Euler about the origin, with what turns the centre of gravity to the right.
        force = force - mass * np.cross(omega, np.cross(omega, cog))
        torque = torque - np.cross(omega, J @ omega)
        a, alpha = np.split(np.linalg.solve(spatial, np.concatenate([force, torque])), 2)
        x, y_, z, w = y[3:7]
        turn = 0.5 * np.array([[w, -z, y_], [z, w, -x], [-y_, x, w], [-x, -y_, -z]]) @ omega
        return np.concatenate([y[7:10], turn, here.apply(a), alpha])

    start = np.concatenate([place, [0, 0, 0, 1], np.zeros(6)])
    rest = solve_ivp(rate, (0, 60), start, args=(False,), rtol=1e-6, atol=1e-9).y[:, -1]
    rest[7:] = np.concatenate([rng.normal(0, 0.15, 3), rng.normal(0, 0.2, 3)])
    span = (time[0], time[-1])
    found = solve_ivp(rate, span, rest, t_eval=time, args=(True,), rtol=1e-9, atol=1e-11).y.T
    rates = np.array([rate(t, y, True) for t, y in zip(time, found, strict=True)])
    tension = np.array([forces(t, y, True)[2] for t, y in zip(time, found, strict=True)])
    turned = Rotation.from_quat(found[:, 3:7])
    return (found[:, :3], turned, found[:, 10:], rates[:, 10:], rates[:, 7:10]), tension


def _matrix(v):
    """Of the cross product with a vector."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def recorded(mass, size, m, rate, stated, prior, seed, delay=0.0):
    """An experiment and its true body, shape (10,)."""
    rng = np.random.default_rng(seed)
    duration = 8.0
    t = np.arange(0.0, duration, 1 / rate)
    moved = motion(t, size, rng)
    arm = 0.05 * size
    round_ = np.linspace(0, 2 * np.pi, m, endpoint=False)
    high = 0.3 * (np.arange(m) % 2)
    anchors = 0.5 * size * np.column_stack([np.cos(round_), np.sin(round_), 0.8 + high])
    attachments = arm * np.column_stack(
        [np.cos(1.3 * round_ + 0.4), np.sin(1.3 * round_ + 0.4), np.arange(m) % 2 - 0.5]
    )
    cog = arm * rng.uniform(-0.3, 0.3, 3)
    A = rng.normal(size=(3, 3)) * 0.2 + np.eye(3)
    spread = mass * arm**2 * (A @ A.T) / 6
    J = np.trace(spread) * np.eye(3) - spread  # of a body that can be
    if m < 6:
        moved, pulled = swinging(t, (mass, cog, J), anchors, attachments, seed)
    place, turned, omega, alpha, acceleration = moved
    R = turned.as_matrix()
    # Newton and Euler about the origin of the platform, in its axes.
    force_free = acceleration + np.array([0.0, 0.0, G])
    f = np.einsum("nji,nj->ni", R, force_free)
    cross = np.cross
    a_cog = f + cross(alpha, cog) + cross(omega, cross(omega, cog))
    torque = omega @ J
    torque = alpha @ J + cross(omega, torque) + cross(cog, mass * a_cog)
    wrench = np.hstack([mass * a_cog, torque])
    points = place[:, None] + np.einsum("nij,mj->nmi", R, attachments)
    along = anchors - points
    pull = np.einsum("nji,nmj->nmi", R, along / np.linalg.norm(along, axis=2)[:, :, None])
    W = np.concatenate([pull, cross(attachments, pull)], axis=2).transpose(0, 2, 1)
    W = W / np.array([1, 1, 1, arm, arm, arm])[:, None]
    scaled = wrench / np.array([1, 1, 1, arm, arm, arm])
    even = np.full(m, 2.0 * mass * G / m)
    inverse = np.linalg.pinv(W)
    tension = even + np.einsum("nmk,nk->nm", inverse, scaled - np.einsum("nkm,m->nk", W, even))
    if m < 6:
        assert np.allclose(np.einsum("nkm,nm->nk", W, pulled), scaled, atol=1e-5 * mass * G)
        tension = pulled
    level = mass * G / m
    noise = {"force": 0.01 * level, "gyro": 2e-3, "acc": 0.03, "place": 1e-4 * size / 3}
    drawn = {"offset": 0.01 * level, "gyro": 5e-3, "acc": 0.05, "turn": 0.01}
    n = len(t)
    turn = Rotation.from_rotvec(rng.normal(0, drawn["turn"], 3))
    target = np.array([0.3, 0.2, 0.9]) * arm
    white = rng.standard_normal
    readings = {
        "cables": {
            "tension": tension + rng.normal(0, drawn["offset"], m) + noise["force"] * white((n, m))
        },
        "imu": {
            "angular_velocity": turn.inv().apply(omega)
            + rng.normal(0, drawn["gyro"], 3)
            + noise["gyro"] * white((n, 3)),
            "specific_force": turn.inv().apply(f)
            + rng.normal(0, drawn["acc"], 3)
            + noise["acc"] * white((n, 3)),
            "orientation": (turned * turn * Rotation.from_rotvec(3e-3 * white((n, 3)))).as_matrix(),
        },
        "tracker": {"position": place + R @ target + noise["place"] * white((n, 3))},
    }
    instruments = {
        "cables": Tension.model_validate({
            "kind": "tension", "noise": stated * noise["force"],
            "calibration": {"offset": prior * drawn["offset"], "gain": 0.0, "common_gain": 0.0},
        }),
        "imu": Imu.model_validate({
            "kind": "imu", "position": (0.0, 0.0, 0.0),
            "noise": {"angular_velocity": stated * noise["gyro"], "specific_force": stated * noise["acc"], "orientation": stated * 3e-3},
            "calibration": {
                "gyro_bias": prior * drawn["gyro"], "accelerometer_bias": prior * drawn["acc"],
                "misalignment": prior * drawn["turn"], "position": 0.0, "reference": 0.0, "delay": 0.0,
            },
        }),
        "tracker": Position.model_validate({
            "kind": "position", "target": tuple(target.tolist()), "noise": stated * noise["place"],
            "calibration": {"target": 0.0, "frame": {"position": 0.0, "rotation": 0.0}, "delay": 0.0},
        }),
    }  # fmt: skip
    streams = {
        name: Stream(t + delay * (name == "tracker"), values, name)
        for name, values in readings.items()
    }
    robot = Robot("abused", anchors, attachments)
    experiment = Experiment(
        "abused", robot, instruments, (Run("moving", streams),),
        uncertainty={"anchor": 0.0, "attachment": 0.0, "gravity": 0.0, "cable_inertia": 0.0},
    )  # fmt: skip
    return experiment, np.array([mass, *cog, J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]])


def judged(estimate, truth):
    """Whether it is accepted, and the squared error over the covariance for each parameter."""
    known = np.isfinite(estimate.value) & np.isfinite(np.diag(estimate.covariance))
    if not known.any():
        return estimate.verdict.accepted, np.nan
    error = (estimate.value - truth)[known]
    sigma = np.sqrt(np.diag(estimate.covariance)[known])
    correlation = estimate.covariance[np.ix_(known, known)] / np.outer(sigma, sigma)
    z = error / sigma
    return estimate.verdict.accepted, float(z @ np.linalg.lstsq(correlation, z)[0]) / known.sum()


def tried(case, seed=0, methods=METHODS):
    """Method -> accepted and squared error, or what was said."""
    experiment, truth = recorded(**{**BASE, **case}, seed=seed)
    found = {}
    for method in methods:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                estimate = steelyard.identify(experiment, method, anyway=True).estimates[method]
            found[method] = judged(estimate, truth)
        except SteelyardError as error:
            found[method] = f"refused: {str(error)[:100]}"
        except Exception as error:  # what should never be: it is printed, and counted
            found[method] = f"ERROR {type(error).__name__}: {error}"
    return found


def main():
    limit = float(sys.argv[1]) if len(sys.argv) > 1 else 1e9
    begun, counts = (
        time.monotonic(),
        dict.fromkeys(("accepted", "not accepted", "refused", "ERROR", "WRONG"), 0),
    )
    for case in ({}, *CASES):
        if len(sys.argv) > 2 and not set(sys.argv[2:]) & set(case):
            continue
        if time.monotonic() - begun > limit:
            print("out of time")
            break
        began = time.monotonic()
        words = []
        for method, how in tried(case).items():
            if isinstance(how, str):
                counts["ERROR" if how.startswith("ERROR") else "refused"] += 1
                words.append(f"{method} {how}")
                continue
            accepted, chi = how
            wrong = bool(accepted is True and chi > MOST)
            counts["WRONG" if wrong else "accepted" if accepted else "not accepted"] += 1
            words.append(f"{method} {'WRONG ' * wrong}{accepted} {chi:.3g}")
        print(f"{case}: {'; '.join(words)} ({time.monotonic() - began:.0f} s)", flush=True)
    print(counts)


if __name__ == "__main__":
    main()
