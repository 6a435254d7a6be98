"""Estimates of several loads in a file, and what one is more than another."""

import json
from dataclasses import replace

import numpy as np
import pytest
from written_estimates import estimate_of, file_of

from steelyard.errors import InputError
from steelyard.estimates.comparison import compare
from steelyard.estimates.estimate import LoadEstimates
from steelyard.estimates.file.places import read_estimates
from steelyard.estimates.joint_covariance import JointCovariance
from steelyard.estimates.named_estimate import NamedEstimate
from steelyard.estimates.payload import payload
from steelyard.inertia import Inertia

EMPTY = np.array([160.0, 0.0, -0.08, -0.12, 95.0, 89.0, 32.0, 4.0, 0.1, -0.4])
ADDED = np.array([16.0, 0.2, -0.1, -0.4, 0.5, 0.6, 0.4, 0.0, 0.0, 0.0])
LOADED = Inertia.from_parameters(
    sum(Inertia.from_body_parameters(each).parameters for each in (EMPTY, ADDED))
).body_parameters


def joint():
    """Both err alike but for a tenth."""
    rng = np.random.default_rng(2)
    root = rng.normal(size=(10, 10)) * 0.003 * np.abs(EMPTY + 0.1)[:, None]
    shared, own = root @ root.T, 0.01 * root @ root.T
    matrix = np.block([[shared + own, shared], [shared, shared + own]])
    return JointCovariance(("empty", "with-fork"), matrix)


def of_loads():
    found = joint()
    estimates = {
        name: replace(estimate_of(value), covariance=found.matrix[own, own])
        for name, value, own in (
            ("empty", EMPTY, slice(0, 10)),
            ("with-fork", LOADED, slice(10, 20)),
        )
    }
    return replace(estimates["empty"], loads=LoadEstimates(estimates, found))


def test_a_file_gives_every_load_with_what_they_share(tmp_path):
    path = file_of(tmp_path, of_loads())
    first, second = read_estimates([str(path), f"{path}#with-fork"])
    assert (first.load, second.load) == ("", "with-fork")
    np.testing.assert_allclose(first.estimate.value, EMPTY)
    np.testing.assert_allclose(second.estimate.value, LOADED)
    np.testing.assert_allclose(second.joint.matrix, joint().matrix)
    (by_method,) = read_estimates([f"{path}:maximum-likelihood#empty"])
    assert by_method.load == "empty"


def test_names_of_loads_distinguish_them(tmp_path):
    path = file_of(tmp_path, of_loads())
    names = [each.name for each in read_estimates([f"{path}#empty", f"{path}#with-fork"])]
    assert names == ["empty", "with-fork"]


def test_a_load_that_is_not_there_is_said(tmp_path):
    path = file_of(tmp_path, of_loads())
    with pytest.raises(
        InputError, match=r"load 'fork' under maximum-likelihood, found empty, with"
    ):
        read_estimates([f"{path}#fork"])
    (tmp_path / "one").mkdir()
    plain = file_of(tmp_path / "one", estimate_of(EMPTY))
    with pytest.raises(InputError, match="found an estimate of one body"):
        read_estimates([f"{plain}#fork"])


def test_a_file_of_that_name_is_no_load(tmp_path):
    odd = tmp_path / "recording#2"
    odd.mkdir()
    (found,) = read_estimates([str(file_of(odd, estimate_of(EMPTY)))])
    assert found.load == ""


def test_what_they_share_cancels(tmp_path):
    path = file_of(tmp_path, of_loads())
    before, after = read_estimates([f"{path}#empty", f"{path}#with-fork"])
    found = payload(before, after).estimate
    np.testing.assert_allclose(found.value, ADDED, atol=1e-9)
    alone = payload(before.estimate, after.estimate).estimate
    assert found.standard_deviation[0] < alone.standard_deviation[0] / 5
    assert "two loads of one fit" in found.notes[0]
    # By draws of both.
    rng = np.random.default_rng(4)
    draws = rng.multivariate_normal(np.concatenate([EMPTY, LOADED]), joint().matrix, 20_000)
    masses = draws[:, 10] - draws[:, 0]
    assert found.standard_deviation[0] == pytest.approx(masses.std(), rel=0.03)
    moments = masses[:, None] ** 0 * (
        draws[:, [10]] * draws[:, 11:14] - draws[:, [0]] * draws[:, 1:4]
    )
    centres = moments / masses[:, None]
    np.testing.assert_allclose(found.standard_deviation[1:4], centres.std(axis=0), rtol=0.05)


def test_a_comparison_of_loads_rests_on_their_joint_covariance(tmp_path):
    path = file_of(tmp_path, of_loads())
    (pair,) = compare(read_estimates([f"{path}#empty", f"{path}#with-fork"])).pairs
    assert pair.basis == "joint"
    own = joint().matrix
    expected = own[:10, :10] + own[10:, 10:] - own[:10, 10:] - own[10:, :10]
    np.testing.assert_allclose(pair.covariance, expected)


def test_loads_of_other_fits_are_independent():
    one, other = (
        NamedEstimate(name, estimate_of(EMPTY), source=name, load=name, joint=joint())
        for name in ("empty", "with-fork")
    )
    assert compare([one, other]).pairs[0].basis == "independent"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda found: found["joint"].update(loads=["empty"]), "expected a matrix of 20 rows"),
        (lambda found: found["joint"].update(matrix=[[1.0]]), "expected a matrix of 20 rows"),
        (lambda found: found["joint"]["matrix"][0].__setitem__(0, -1.0), "joint.matrix"),
    ],
)
def test_a_joint_covariance_that_is_none_is_said(tmp_path, change, said):
    path = file_of(tmp_path, of_loads())
    values = json.loads(path.read_text())
    change(values["estimates"]["maximum-likelihood"])
    path.write_text(json.dumps(values))
    with pytest.raises(InputError) as error:
        read_estimates([f"{path}#empty"])
    assert said in str(error.value)
