from dataclasses import replace

import numpy as np
import pytest

from steelyard.dynamics import platform_wrench
from steelyard.identification.methods.settings import TwoStepSettings
from steelyard.identification.methods.two_step import TwoStep, estimate_two_step
from steelyard.identification.samples.prepared import Samples
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.motion.state import motion_of_poses
from steelyard.motion.trajectory import multisine
from steelyard.robot.file import read_robot

EXACT = 1e-9  # relative: on exact signals only rounding is left
BODY = read_robot("cogiro").platform
SIZE = read_robot("cogiro").size
GRAVITY = np.array([0, 0, -9.81])


def samples(
    *,
    axes=(1, 1, 1, 1, 1, 1),
    n=400,
    body=BODY,
    offset=None,
    noise=None,
    rng=None,
    name="run",
    alpha_noise=0.0,
    trajectory=None,
):
    """Exact samples of a motion in body axes, with a wrench that may have an offset and white
    noise."""
    trajectory = trajectory or multisine(
        [0, 0, 2, 0.1, 0, 0], np.array([0.5, 0.5, 0.4, 0.35, 0.3, 0.5]) * axes, 20, harmonics=9
    )
    t = np.linspace(1, 19, n)
    motion = motion_of_poses(*(trajectory.derivative(t, k) for k in range(3)), GRAVITY)
    wrench = platform_wrench(
        body.parameters, motion["specific_force"], motion["omega"], motion["alpha"]
    )
    if offset is not None:
        wrench = wrench + offset
    if noise is not None:
        wrench = wrench + rng.normal(size=wrench.shape) * noise
    return Samples(
        run=name,
        time=t,
        omega=motion["omega"],
        alpha=motion["alpha"],
        specific_force=motion["specific_force"],
        wrench=wrench,
        static=False,
        free_offset=offset is not None,
        alpha_noise=alpha_noise,
        spacing=0.0,
        position_sigma=0.0,
    )


def poses(body, rotations, offset=None):
    """Exact samples at rest."""
    n = len(rotations)
    still = np.zeros((n, 3))
    force_samples = np.einsum("nji,j->ni", rotations, -GRAVITY)
    wrench = platform_wrench(body.parameters, force_samples, still, still) + (
        0 if offset is None else offset
    )
    return Samples(
        run="poses",
        time=np.arange(n, dtype=float),
        omega=still,
        alpha=still,
        specific_force=force_samples,
        wrench=wrench,
        static=True,
        free_offset=offset is not None,
        alpha_noise=0.0,
        spacing=0.0,
        position_sigma=0.0,
    )


def told(estimate):
    return {
        name
        for name, value in zip(BODY_PARAMETERS, estimate.value, strict=True)
        if np.isfinite(value)
    }


def test_exact_signals_give_the_body_back():
    estimate = estimate_two_step([samples()], SIZE)
    np.testing.assert_allclose(estimate.value, BODY.body_parameters, rtol=EXACT, atol=EXACT)
    # Nothing but physics was looked at.
    assert estimate.verdict.accepted is None
    assert str(estimate.verdict) == "baseline, not assessed"
    assert estimate.physical


def test_constant_offsets_of_a_wrench_sensor_are_unknowns_like_the_others():
    offset = np.array([12.0, -7.0, 30.0, 2.0, -1.0, 0.5])
    estimate = estimate_two_step([samples(offset=offset)], SIZE)
    np.testing.assert_allclose(estimate.value, BODY.body_parameters, rtol=1e-8, atol=1e-8)
    found = estimate.details["offset"]
    np.testing.assert_allclose(found["value"], offset, atol=1e-7)


def test_translation_alone_tells_the_mass_only():
    assert told(estimate_two_step([samples(axes=(1, 1, 1, 0, 0, 0))], SIZE)) == {"mass"}


def test_rotation_about_one_axis_tells_what_couples_to_it(rng):
    # About the world's vertical, which stays the platform's z axis: c_z shows neither in the forces
    # nor in Eq. (6).
    level = multisine([0, 0, 2, 0, 0, 0], [0.5, 0.5, 0.4, 0, 0, 0.8], 20, harmonics=9)
    estimate = estimate_two_step([samples(trajectory=level)], SIZE)
    assert told(estimate) >= {"mass", "cx", "cy", "Jzz"}
    assert not told(estimate) & {"cz", "Jxx", "Jyy", "Jxy"}
    for name, label in (("cz", "cog z"), ("Jxx", "Jxx"), ("Jyy", "Jyy")):
        assert estimate.verdict.parameters[name] == "unidentifiable"
        assert any(label in note for note in estimate.notes)
    np.testing.assert_allclose(estimate.value[6], BODY.inertia[2, 2], rtol=1e-6)


def test_what_counts_as_excited_can_be_set():
    noisy = replace(samples(), alpha_noise=1e-3)
    assert told(estimate_two_step([noisy], SIZE)) == set(BODY_PARAMETERS)
    strict = TwoStepSettings(noise_margin=1e12)
    assert "cz" not in told(estimate_two_step([noisy], SIZE, settings=strict))


def test_noise_in_the_regressor_is_not_taken_for_motion(rng):
    still = samples(axes=(1, 1, 1, 0, 0, 0))
    shaky = replace(
        still, alpha=still.alpha + rng.normal(size=still.alpha.shape) * 0.05, alpha_noise=0.05
    )
    assert told(estimate_two_step([shaky], SIZE)) == {"mass"}


def test_static_poses_give_mass_and_centre_of_gravity():
    from scipy.spatial.transform import Rotation

    body = Inertia(0.932, [0.0003, 0.0, 0.0439], np.diag([0.004, 0.004, 0.001]))
    offset = np.array([9.0, -1.0, 10.0, 0.43, -0.69, -0.16])
    rotations = Rotation.random(12, rng=1).as_matrix()
    estimate = estimate_two_step([poses(body, rotations, offset)], 0.3)
    np.testing.assert_allclose(estimate.value[:4], body.body_parameters[:4], rtol=1e-9, atol=1e-11)
    assert told(estimate) == {"mass", "cx", "cy", "cz"}
    assert estimate.physical is None


def test_poses_of_one_attitude_tell_the_centre_of_gravity_across_gravity_only():
    assert told(estimate_two_step([poses(BODY, np.tile(np.eye(3), (6, 1, 1)))], SIZE)) == {
        "mass",
        "cx",
        "cy",
    }


def test_poses_help_the_inertia_of_a_motion_that_does_not_tell_the_centre_of_gravity():
    from scipy.spatial.transform import Rotation

    level = multisine([0, 0, 2, 0, 0, 0], [0.5, 0.5, 0.4, 0, 0, 0.8], 20, harmonics=9)
    at_rest = poses(BODY, Rotation.random(12, rng=1).as_matrix())
    estimate = estimate_two_step([samples(trajectory=level), at_rest], SIZE)
    assert told(estimate) >= {"mass", "cx", "cy", "cz", "Jzz", "Jxz", "Jyz"}
    np.testing.assert_allclose(
        estimate.value[[6, 7, 8]], BODY.body_parameters[[6, 7, 8]], rtol=1e-6, atol=1e-6
    )


def test_median_over_runs_ignores_one_bad_run_and_pooling_does_not():
    good = [samples(name=f"good {i}") for i in range(4)]
    bad = samples(name="bad", body=replace(BODY, mass=200.0))
    median = estimate_two_step([*good, bad], SIZE)
    pooled = estimate_two_step([*good, bad], SIZE, "pooled")
    np.testing.assert_allclose(median.value, BODY.body_parameters, rtol=1e-8, atol=1e-8)
    assert pooled.value[0] > 165
    assert set(median.runs) == {"good 0", "good 1", "good 2", "good 3", "bad"}
    np.testing.assert_allclose(median.runs["bad"].value[0], 200.0, rtol=1e-9)


@pytest.mark.integration
def test_covariance_holds_over_seeds_of_white_noise():
    # Errors in the wrench alone, at which the stated covariance aims: the part of both steps that
    # noise reaches linearly.
    noise = np.array([8.0, 8.0, 8.0, 4.0, 4.0, 4.0])
    errors, variances = [], []
    for seed in range(200):
        estimate = estimate_two_step([samples(noise=noise, rng=np.random.default_rng(seed))], SIZE)
        errors.append(estimate.value - BODY.body_parameters)
        variances.append(np.diag(estimate.covariance))
    normalised = np.array(errors) ** 2 / np.array(variances)
    # 95 % of a chi-square of 200 samples per parameter, two-sided with room for ten of them.
    assert np.all(np.abs(normalised.mean(axis=0) - 1) < 0.35)
    assert abs(normalised.mean() - 1) < 0.12


def test_an_impossible_body_is_not_accepted_and_says_why():
    impossible = Inertia(
        170.740,
        [0.112, -0.134, -0.125],
        [[102.982, -3.672, -0.132], [-3.672, 52.744, 8.588], [-0.132, 8.588, 46.589]],
    )
    estimate = estimate_two_step([samples(body=impossible)], SIZE)
    assert estimate.physical is False
    assert estimate.verdict.accepted is False
    assert "40.48, 58.58 and 103.3" in estimate.verdict.reasons[0]
    assert "4.2 kg m^2 beyond" in estimate.verdict.reasons[0]


def test_inputs_stay_as_they_are():
    run = samples()
    before = {
        key: np.array(value) for key, value in vars(run).items() if isinstance(value, np.ndarray)
    }
    estimate_two_step([run], SIZE)
    for key, value in before.items():
        np.testing.assert_array_equal(getattr(run, key), value)


def test_settings_are_a_value():
    assert TwoStep() == TwoStep(acceleration=None, combine="median")
