"""One recording in every format gives one estimate."""

import json
import tempfile
from functools import cache
from pathlib import Path

import log_files as files
import numpy as np
import pytest
from recordings import RUN, table, write_small
from rosbags.rosbag2 import StoragePlugin

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.two_step import TwoStep

pytestmark = pytest.mark.integration

AGREEMENT = 1e-9
"""Relative; numbers are exact in all formats, and times are in whole microseconds."""

METHODS = ["two-step", "least-squares"]
UNITS = {
    "cables": {"t": "s", **{f"f{j + 1}": "N" for j in range(files.CABLES)}},
    "imu": {
        "t": "s",
        "wx": "rad/s",
        "wy": "rad/s",
        "wz": "rad/s",
        "ax": "m/s^2",
        "ay": "m/s^2",
        "az": "m/s^2",
    },
    "tracker": {"t": "s", "x": "m", "y": "m", "z": "m"},
}


def each(ending, write):
    """One file for each instrument; its place is but a path."""

    def writer(folder, found):
        for name, values in found.items():
            write(folder / f"{name}{ending}", values, name)
        return {name: f"{name}{ending}" for name in found}

    return writer


def together(file, write, columns=False, topic="/{}"):
    """One file for all; its place is a topic of it, with columns where names are not those of the
    contract or of messages."""

    def writer(folder, found):
        write(folder / file, found)
        return {
            name: {
                "file": file,
                "topic": topic.format(name),
                **({"columns": files.ARRAY_COLUMNS[name]} if columns else {}),
            }
            for name in found
        }

    return writer


def write_npz(folder, found):
    for name, values in found.items():
        files.write_npz(folder / f"{name}.npz", values, name)
    return {name: {"file": f"{name}.npz", "columns": files.ARRAY_COLUMNS[name]} for name in found}


def exported(path, values, name):
    """As software that speaks German saves it."""
    files.write_csv(path, values, separator=";", comma=True, units=UNITS[name])


FORMATS = {
    "csv": each(".csv", lambda path, values, _: files.write_csv(path, values)),
    "csv with semicolons, decimal commas and units in UTF-16": each(".csv", exported),
    "csv.gz": each(".csv.gz", lambda path, values, _: files.write_csv(path, values)),
    "parquet": each(".parquet", lambda path, values, _: files.write_parquet(path, values)),
    "mcap of JSON": together("all.mcap", files.write_mcap_json),
    "mcap of ROS 2": together("all.mcap", files.write_mcap_ros2),
    "mcap of ROS 1": together("all.mcap", files.write_mcap_ros1, topic="{}"),
    "bag of ROS 1": together("all.bag", files.write_bag),
    "bag of ROS 2": together("all", files.write_bag2),
    "bag of ROS 2 in mcap": together(
        "all", lambda path, found: files.write_bag2(path, found, StoragePlugin.MCAP)
    ),
    "database of ROS 2": together("all.db3", files.write_old_database),
    "HDF5": together("all.h5", files.write_hdf5, columns=True),
    "MATLAB 5": together("all.mat", files.write_mat, columns=True, topic="{}"),
    "MATLAB 7.3": together("all.mat", files.write_mat73, columns=True, topic="{}"),
    "TDMS": together("all.tdms", files.write_tdms, topic="{}"),
    "npz": write_npz,
}


@cache
def recorded():
    """The small recording, with times in whole microseconds."""

    def columns(path):
        rows = table(path)
        values = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
        values["t"] = np.array([files.nanoseconds(t) for t in values["t"]]) / 1e9
        return values

    with tempfile.TemporaryDirectory() as temporary:
        write_small(Path(temporary))
        return {
            name: columns(Path(temporary) / RUN / f"{name}.csv")
            for name in ("cables", "imu", "tracker")
        }


def estimates(folder, form):
    """Estimates of both methods from the recording in one format."""
    experiment = write_small(folder)
    places = FORMATS[form](folder, recorded())
    head, _, runs = experiment.read_text().partition("runs:\n")
    sync = next(line for line in runs.splitlines() if "sync:" in line)
    streams = "".join(f"    {name}: {json.dumps(place)}\n" for name, place in places.items())
    experiment.write_text(f"{head}runs:\n  - name: {RUN}\n{streams}{sync}\n")
    return identify(read_experiment(experiment), [TwoStep(), LeastSquares()]).estimates


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return estimates(tmp_path_factory.mktemp("reference"), "csv")


@pytest.mark.slow
@pytest.mark.parametrize("form", [form for form in FORMATS if form != "csv"])
def test_estimates_agree(tmp_path, reference, form):
    found = estimates(tmp_path, form)
    for method in METHODS:
        want = reference[method]
        np.testing.assert_allclose(found[method].value, want.value, rtol=AGREEMENT, err_msg=method)
        np.testing.assert_allclose(
            found[method].covariance, want.covariance, rtol=AGREEMENT, atol=1e-15
        )
