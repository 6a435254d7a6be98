"""Estimates while data arrive, side by side: `python benchmarks/live_methods.py [RECORDINGS] [ROBOT] [CONDITION]`.

Recursive least squares, recursive total least squares [Kubus2008] and an extended Kalman filter
have the friendlier version of a recording of the public benchmark: one clock, mounting, geometry
and gains exact, the wrench on the platform. `recursive` has its raw streams.
"""

from __future__ import annotations

import sys
from collections import deque
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "public"))

from generate import CONDITIONS, ROBOTS, recorded, seed_of, write
from peers.extended_kalman_filter import bodies
from peers.filtered import CUT_OFF, pinocchio_regressor, with_covariance
from peers.steelyard_files import written
from recording import Array, Platform, read_platform
from scipy.signal import butter, lfilter, lfilter_zi

from steelyard.experiment.read import read_experiment
from steelyard.identification.recursive.follow import follow

INSTANTS = np.array([8.0, 10.0, 15.0, 20.0])
"""After the beginning of a recording [s]."""
BEGINNING = 5.0
"""From which the regressions take how certain each axis of the wrench is [s]."""
FIRST = 100
"""Number of the first recording: others than those of the public table."""


def _rows(data: Platform) -> tuple[Array, Array, Array]:
    """Times, regressor with a constant wrench, shape (n, 6, 16), and wrench, shape (n, 6), filtered
    forwards only and alike, at twice the cut-off.
    """
    b, a = butter(2, CUT_OFF, fs=1 / data.step)
    start = lfilter_zi(b, a)
    smooth = lambda each: lfilter(b, a, each, axis=0, zi=start[:, None] * each[0])[0]  # noqa: E731
    omega, force = smooth(data.omega), smooth(data.specific_force)
    alpha = np.vstack([np.zeros(3), np.diff(omega, axis=0) / data.step])
    kept = slice(0, None, max(1, round(1 / (2 * CUT_OFF * data.step))))
    Y = pinocchio_regressor(omega[kept], alpha[kept], force[kept])
    Y = np.concatenate([Y, np.tile(np.eye(6), (len(Y), 1, 1))], axis=2)
    w, t = smooth(data.wrench)[kept], data.t[kept]
    early = t < t[0] + BEGINNING
    sigma = np.ones(6)
    for _turn in range(3):
        A, r = Y[early] / sigma[:, None], w[early] / sigma
        found = np.linalg.lstsq(A.reshape(-1, 16), r.ravel(), rcond=None)[0]
        sigma = (w[early] - Y[early] @ found).std(axis=0)
    return t, Y / sigma[:, None], w / sigma


def least_squares(data: Platform, instants: Array) -> list[tuple[Array, Array]]:
    """Recursive least squares without forgetting, covariance by the variance of the innovations."""
    times, rows, wrench = _rows(data)
    # From nothing: a thousand times as uncertain as one reading tells.
    x, P = np.zeros(16), np.diag(1e6 / np.mean(rows**2, axis=(0, 1)))
    squares, count, found, due = 0.0, 0, [], list(instants)
    for t, Y, w in zip(times, rows, wrench, strict=True):
        while due and t > due[0]:
            found.append(with_covariance(x[:10], P[:10, :10] * squares / max(count - 16, 1)))
            due.pop(0)
        S = np.eye(6) + Y @ P @ Y.T
        gain = np.linalg.solve(S, Y @ P).T
        innovation = w - Y @ x
        squares, count = squares + innovation @ np.linalg.solve(S, innovation), count + 6
        if count <= 16:
            squares = 0.0  # What a start from nothing is surprised by.
        left = np.eye(16) - gain @ Y
        x, P = x + gain @ innovation, left @ P @ left.T + gain @ gain.T
    return found + [
        with_covariance(x[:10], P[:10, :10] * squares / max(count - 16, 1)) for _ in due
    ]


def total_least_squares(data: Platform, instants: Array) -> list[tuple[Array, Array]]:
    """Recursive total least squares: the products of [regressor, wrench] are updated, the least
    eigenvector follows by inverse iteration [Kubus2008]; the constant wrench has no error.
    """
    times, rows, wrench = _rows(data)
    N, vector, count = np.zeros((17, 17)), np.ones(11), 0
    found, due = [], list(instants)

    def current() -> tuple[Array, Array]:
        keep, fixed = np.r_[0:10, 16], np.arange(10, 16)
        inner = (
            N[np.ix_(keep, keep)]
            - N[np.ix_(keep, fixed)]
            @ np.linalg.lstsq(N[np.ix_(fixed, fixed)], N[np.ix_(fixed, keep)], rcond=None)[0]
        )
        scale = np.sqrt(np.diag(inner))
        scaled, last = inner / np.outer(scale, scale), vector
        for _step in range(3):
            last = np.linalg.solve(scaled, last)
            last = last / np.linalg.norm(last)
        vector[:] = last
        least = float(last @ scaled @ last)
        y = -last[:10] / last[10]
        variance = least / (count - 16) * (1 + y @ y)
        back = scale[10] / scale[:10]
        covariance = variance * np.linalg.inv(scaled[:10, :10] - least * np.eye(10))
        return with_covariance(y * back, covariance * np.outer(back, back))

    for t, Y, w in zip(times, rows, wrench, strict=True):
        while due and t > due[0]:
            found.append(current())
            due.pop(0)
        block = np.column_stack([Y, w])
        N, count = N + block.T @ block, count + 6
        if count > 120:
            current()
    return found + [current() for _ in due]


def kalman_filter(data: Platform, instants: Array) -> list[tuple[Array, Array]]:
    """The extended Kalman filter of the public benchmark, one pass."""
    return bodies(data, instants, turns=1)


def recursive(folder: Path, instants: Array, scratch: Path) -> list[tuple[Array, Array]]:
    """The method `recursive` of this package on the raw streams."""
    (last,) = deque(follow(read_experiment(written(folder, scratch))), maxlen=1)
    times = np.array([each.time for each in last.instants])
    # A chunk is known when it has passed; times are those of the recording.
    origin = times[-1] - instants[-1]
    at = np.maximum(np.searchsorted(times, instants + origin + 1e-6) - 1, 0)
    return [(last.instants[i].value, last.instants[i].covariance) for i in at]


METHODS = {
    "recursive least squares": least_squares,
    "recursive total least squares": total_least_squares,
    "extended Kalman filter": kalman_filter,
}


def _scores(found: list[tuple[Array, Array]], truth: Array) -> Array:
    """Relative errors of mass, centre of gravity (over the radius of gyration) and inertia, chi-square
    over 10, share of 95 % intervals that contain the truth; at every instant, shape (k, 5).
    """
    gyration = np.sqrt(truth[4:7].sum() / 2 / truth[0])
    twice = np.r_[np.ones(3), np.full(3, np.sqrt(2))]
    rows = []
    for value, covariance in found:
        error = value - truth
        sigma = np.sqrt(np.diag(covariance))
        rows.append(
            [
                abs(error[0]) / truth[0],
                np.linalg.norm(error[1:4]) / gyration,
                np.linalg.norm(twice * error[4:]) / np.linalg.norm(twice * truth[4:]),
                error @ np.linalg.solve(covariance, error) / 10,
                np.mean(np.abs(error) < 1.96 * sigma),
            ]
        )
    return np.array(rows)


def main(count: int, robot: str, condition: str) -> None:
    """Print the table."""
    scores: dict[str, list[Array]] = {}
    for number in range(FIRST, FIRST + count):
        name = f"{robot}/{condition}-{number:02d}"
        made = recorded(
            ROBOTS[robot], CONDITIONS[condition], name, seed_of(robot, condition, number)
        )
        truth = np.array(made.truth["value"])
        with TemporaryDirectory() as scratch:
            folder = Path(scratch) / "given"
            write(made, folder, Path(scratch) / "truth.json")
            data = read_platform(folder)
            instants = data.t[0] + INSTANTS
            for label, method in METHODS.items():
                scores.setdefault(label, []).append(_scores(method(data, instants), truth))
            own = Path(scratch) / "own"
            own.mkdir()
            try:
                found = recursive(folder, INSTANTS, own)
            except Exception as error:
                print(f"{name}: recursive: {error}", file=sys.stderr)
                continue
            scores.setdefault("steelyard, recursive", []).append(_scores(found, truth))
    print(
        f"{count} recordings of `{robot}/{condition}`, medians over them; 95 % over all intervals"
    )
    print("method                             at     mass  centre  inertia  chi2/10   95 %")
    for label, each in scores.items():
        values = np.array(each)
        for i, instant in enumerate(INSTANTS):
            mass, centre, inertia, chi = np.median(values[:, i, :4], axis=0)
            print(
                f"{label:32s} {instant:3.0f} s {100 * mass:6.2f} % {100 * centre:5.2f} %"
                f" {100 * inertia:6.2f} % {chi:8.2f} {100 * values[:, i, 4].mean():5.0f} %"
            )


if __name__ == "__main__":
    given = sys.argv[1:]
    main(
        int(given[0]) if given else 6,
        given[1] if len(given) > 1 else "cogiro",
        given[2] if len(given) > 2 else "plain",
    )
