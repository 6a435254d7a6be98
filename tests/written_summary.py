"""A summary of given numbers, as `identify` would gather it."""

import numpy as np

from steelyard.report.evidence.summary import (
    ATTAINABLE,
    ParameterColumn,
    ParameterTable,
    Summary,
)
from steelyard.report.evidence.values import EstimatedBody, Evidence, Made, Trace

TRUTH = (161.058, -1.0, -77.0, -118.0, 94.955, 88.859, 31.635, 4.136, -0.085, -0.393)
SIGMA = (0.382, 1.66, 1.26, 2.26, 0.48, 0.602, 0.597, 0.397, 0.37, 0.286)
METHODS = (
    "maximum-likelihood",
    "two-step",
    "least-squares",
    "instrumental-variables",
    "consistent",
    "recursive",
)


def column(name, place):
    errors = [(-1.0) ** (i + place) * s * (0.3 + 0.4 * place) for i, s in enumerate(SIGMA)]
    errors[7] = -0.001  # rounds to nothing
    wide = [s * (1 + place) for s in SIGMA]
    values = [t + e for t, e in zip(TRUTH, errors, strict=True)]
    return ParameterColumn(name, tuple(values), tuple(wide), tuple(errors))


def body(name):
    covariance = np.diag(np.square(np.array(SIGMA) / [1, *[1e3] * 3, *[1] * 6]))
    value = np.array(TRUTH) / [1, *[1e3] * 3, *[1] * 6]
    return EstimatedBody(
        name, name, tuple(value), tuple(map(tuple, covariance.tolist())), ("data",) * 10, True, ()
    )


def summary(count):
    names = METHODS[:count]
    columns = [column(name, i) for i, name in enumerate(names)]
    columns[1:1] = [
        ParameterColumn("nominal = truth", TRUTH, None),
        ParameterColumn(ATTAINABLE, SIGMA, None),
    ]
    runs = [ParameterColumn(f"run-{i}", TRUTH, tuple(5 * s for s in SIGMA)) for i in range(8)]
    return Summary(
        table=ParameterTable("CoGiRo, 20 s on all six axes", tuple(columns)),
        runs=(ParameterTable("two-step, each run alone", tuple(runs)),),
        statements=(
            *(f"{name}: accepted" for name in names),
            "two-step: its 1-sigma comes from the residuals; it does not contain cables.offset,"
            " imu.misalignment, imu.gyro_bias, the weight of the cables",
        ),
        result=names[0],
        bodies=tuple(map(body, names)),
        nominal=TRUTH,
        truth=TRUTH,
        attainable=SIGMA,
        per_mass=None,
        evidence=Evidence(),
        made=Made((("steelyard", "1"),), ()),
    )


def traces(runs):
    """Two instruments in every run."""
    time = tuple(np.linspace(0, 1, 30).tolist())
    wave = tuple(np.sin(np.array(time) * 9).tolist())
    return tuple(
        Trace(
            run=run, instrument=name, quantity="position", unit="m", channels=("x",), time=time, measured=(wave,),
            residual=(wave,), sigma=(1.0,), rms=(0.7,), worst=1.0, outliers=0, left_out=(), samples=30, static=False,
            spectrum=None,
        )
        for run in runs
        for name in ("tracker", "total-station")
    )  # fmt: skip
