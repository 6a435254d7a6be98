"""Streams as columns of the contract, against SciPy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.experiment.columns import stream_columns
from steelyard.instruments import Attitude, Tension

TIME = np.linspace(0, 3, 301)
TURNED = Rotation.from_rotvec(np.outer(3 * TIME, [0.2, 1.0, -0.4]))
"""More than once around, so that quaternions change their sign."""


def attitude():
    return Attitude(kind="attitude")


def test_quaternions_have_no_jumps_and_are_the_same_rotations():
    matrices = TURNED.as_matrix().copy()
    matrices[7] = np.nan
    columns = stream_columns(TIME, {"orientation": matrices}, attitude(), 8)
    assert list(columns) == ["t", "qw", "qx", "qy", "qz"]
    assert columns["t"][1] == "s"
    assert columns["qw"][1] == "1"
    quaternions = np.column_stack([columns[f"q{axis}"][0] for axis in "wxyz"])
    assert np.isnan(quaternions[7]).all()
    there = np.delete(quaternions, 7, axis=0)
    assert there[0, 0] >= 0
    assert np.linalg.norm(np.diff(there, axis=0), axis=1).max() < 0.05
    back = Rotation.from_quat(there, scalar_first=True)
    errors = (back.inv() * TURNED[np.delete(np.arange(len(TIME)), 7)]).magnitude()
    assert errors.max() < 1e-12


def test_one_column_for_each_cable():
    force = np.arange(12.0).reshape(4, 3)
    columns = stream_columns(None, {"tension": force}, Tension(kind="tension"), 3)
    assert {name: unit for name, (_, unit) in columns.items()} == {"f1": "N", "f2": "N", "f3": "N"}
    np.testing.assert_array_equal(np.column_stack([v for v, _ in columns.values()]), force)
