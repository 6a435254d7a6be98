"""Inertia in every convention of files, against a cloud of point masses."""

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.imports.description import DescribedBody as Body
from steelyard.imports.nominal_body import nominal_body

RNG = np.random.default_rng(5)
POINTS, MASSES = (
    RNG.normal(size=(40, 3)) * [0.5, 0.3, 0.2] + [0.1, -0.2, 0.3],
    RNG.uniform(1, 4, 40),
)
MASS = MASSES.sum()
CENTRE = MASSES @ POINTS / MASS


def integrals(origin):
    """Sums of m x y and so on about a point."""
    r = POINTS - origin
    return np.einsum("n,ni,nj->ij", MASSES, r, r)


def matrix_about(origin):
    second = integrals(origin)
    return np.trace(second) * np.eye(3) - second


def body(convention, about, stated=None):
    """As a file would state it; ``stated`` is what it says of its convention."""
    origin = CENTRE if about == "cog" else np.zeros(3)
    J, second = matrix_about(origin), integrals(origin)
    values = J if convention == "matrix" else second
    products = (values[1, 2], values[0, 2], values[0, 1])
    return Body(
        "a.xml:3: 'inertia'",
        MASS,
        tuple(CENTRE),
        tuple(np.diag(J)),
        products,
        stated,
        "the format does not say",
        about,
    )


@pytest.mark.parametrize("convention", ["matrix", "integral"])
@pytest.mark.parametrize("about", ["cog", "origin"])
def test_every_convention_is_the_same_body(convention, about):
    found = nominal_body(body(convention, about), products=convention, about=None)
    assert found.convention == convention
    assert found.inertia.mass == pytest.approx(MASS)
    np.testing.assert_allclose(found.inertia.center_of_gravity, CENTRE)
    np.testing.assert_allclose(found.inertia.inertia, matrix_about(CENTRE), atol=1e-10)


def test_the_format_may_say_it_and_the_user_is_above_the_format():
    stated = body("integral", "cog", "matrix")
    assert nominal_body(stated, products=None, about=None).convention == "matrix"
    assert nominal_body(stated, products="integral", about=None).convention == "integral"


def test_a_sign_that_nobody_says_is_asked_for():
    with pytest.raises(InputError, match="say with products matrix"):
        nominal_body(body("matrix", "cog"), products=None, about=None)


def test_a_point_that_the_files_state_is_not_overruled():
    with pytest.raises(InputError, match="about: expected none"):
        nominal_body(body("matrix", "origin", "matrix"), products=None, about="cog")


def test_physics_is_reported():
    thin = Body("a:1", 1.0, (0, 0, 0), (1.0, 1.0, 5.0), (0, 0, 0), None, "")
    found = nominal_body(thin, products=None, about=None)
    assert found.convention is None
    assert "no solid body has this inertia: its principal moments are 1, 1, 5" in found.notes[0]
