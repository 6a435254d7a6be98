"""An extended Kalman filter: angular velocity and acceleration, specific force, the ten and a constant
wrench as one state (NumPy)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from recording import Array, Platform, read_platform

from peers.filtered import filtered, pinocchio_regressor, with_covariance

NAME = "extended Kalman filter (NumPy)"
DATA = "platform"
OMEGA, ALPHA, FORCE, TEN, OFFSET = (
    slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 19), slice(19, 25),
)  # fmt: skip


def estimate(folder: Path) -> tuple[Array, Array]:
    """The ten after two passes, and the filter's own covariance."""
    data = read_platform(folder)
    return bodies(data, data.t[-1:], turns=2)[0]


def bodies(data: Platform, instants: Array, *, turns: int) -> list[tuple[Array, Array]]:
    """The ten and their covariance at instants [s] of the last of some passes; a second pass is
    linearised about the body that the first one found.
    """
    smooth = filtered(data)
    h = data.step
    # White noise of the readings from neighbours; that of the motion from the filtered one.
    noise = lambda each: np.diff(each, n=3, axis=0).std(axis=0) / np.sqrt(20)  # noqa: E731
    walk = lambda each: (  # noqa: E731
        np.diff(each, axis=0).std(axis=0) / np.sqrt(smooth.motion.step)
    )
    readings = np.hstack([data.omega, data.specific_force, data.wrench])
    R = np.diag(noise(readings) ** 2)
    Q = np.zeros((25, 25))
    Q[ALPHA, ALPHA] = np.diag(walk(smooth.alpha) ** 2 * h)
    Q[FORCE, FORCE] = np.diag(walk(smooth.motion.specific_force) ** 2 * h)
    F = np.eye(25)
    F[OMEGA, ALPHA] = h * np.eye(3)
    mean = data.wrench.mean(axis=0)
    mass = np.linalg.norm(mean[:3]) / 9.81
    length = np.sqrt(np.abs(np.linalg.norm(data.wrench[:, 3:].std(axis=0)) / mass) + 0.01)
    x = np.zeros(25)
    x[TEN][0] = mass
    x[TEN][[4, 6, 9]] = mass * length**2
    sizes = np.concatenate(
        [
            np.full(3, 0.01), np.full(3, 1.0), np.full(3, 0.1), [0.3 * mass],
            np.full(3, mass * length), np.full(6, 2 * mass * length**2),
            0.02 * np.linalg.norm(mean[:3]) * np.array([1, 1, 1, length, length, length]),
        ]
    )  # fmt: skip
    found, last = [], np.searchsorted(data.t, instants, side="right") - 1
    for turn in range(turns):
        P = np.diag(sizes**2)
        x[FORCE], x[OMEGA], x[ALPHA] = data.specific_force[0], data.omega[0], 0.0
        for i, reading in enumerate(readings):
            x, P = F @ x, F @ P @ F.T + Q
            motion = (x[OMEGA][None], x[ALPHA][None], x[FORCE][None])
            Y = pinocchio_regressor(*motion)[0]
            H = np.zeros((12, 25))
            H[0:3, OMEGA], H[3:6, FORCE] = np.eye(3), np.eye(3)
            H[6:, TEN], H[6:, OFFSET] = Y, np.eye(6)
            # The wrench is linear in acceleration and quadratic in velocity.
            for part, place in enumerate((OMEGA, ALPHA, FORCE)):
                for axis in range(3):
                    up, down = ([each.copy() for each in motion] for _ in range(2))
                    up[part][0, axis] += 1e-3
                    down[part][0, axis] -= 1e-3
                    change = pinocchio_regressor(*up)[0] - pinocchio_regressor(*down)[0]
                    H[6:, place.start + axis] = change @ x[TEN] / 2e-3
            expected = np.concatenate([x[OMEGA], x[FORCE], Y @ x[TEN] + x[OFFSET]])
            S = H @ P @ H.T + R
            gain = np.linalg.solve(S, H @ P).T
            x = x + gain @ (reading - expected)
            left = np.eye(25) - gain @ H
            P = left @ P @ left.T + gain @ R @ gain.T
            if turn == turns - 1 and i in last:
                found.append(with_covariance(x[TEN], P[TEN, TEN]))
    return found
