import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from steelyard.bodies import consistent_body
from steelyard.bodies.consistent_body import BodyProblem, covariance, solve
from steelyard.bodies.mass_region import Box, Ellipsoid
from steelyard.bodies.nearest_body import nearest_body
from steelyard.bodies.whitened_problem import smat, svec
from steelyard.errors import InputError, SteelyardError
from steelyard.inertia import Inertia

AGREEMENT = 1e-6  # the named tolerance of the module: sigmas per (1 + distance)
MILLION = 1e6


def cloud(rng, mass=1.0, size=1.0):
    """A body of point masses, anywhere near the origin, with the points."""
    points = size * (rng.normal(size=(12, 3)) * rng.uniform(0.3, 1.0, 3) + rng.normal(size=3))
    masses = rng.uniform(0.1, 1.0, 12)
    return Inertia.from_points(masses * mass / masses.sum(), points), points


def whitener(body):
    L = np.linalg.cholesky(body.pseudo_inertia)
    return lambda P: np.linalg.solve(L, np.linalg.solve(L, P).T).T


def random_problem(rng, *, spread=1.0, step=1.0, untold=0, **settings):
    """A body, a reference beside it, random information, and an estimate that lies off by so many
    bodies."""
    mass, size = 10 ** rng.uniform(-2, 4), 10 ** rng.uniform(-1.5, 1.5)
    body, points = cloud(rng, mass, size)
    reference = Inertia.from_points(
        rng.uniform(0.5, 2.0, 12) * mass / 12, points * rng.uniform(0.7, 1.4, 3)
    )
    D = BodyProblem(body.parameters, np.zeros((10, 10)), body).to_whitened
    scales = 10 ** rng.uniform(-spread, spread, 10)
    scales[:untold] = 0.0
    F = scales[:, None] * np.linalg.qr(rng.normal(size=(10, 10)))[0] @ D
    estimate = body.parameters + np.linalg.solve(D, step * rng.normal(size=10))
    return BodyProblem(estimate, F.T @ F, reference, **settings), body, points


def pseudo_inertia(parameters):
    """From the definition by hand."""
    m, hx, hy, hz, xx, yy, zz, yz, xz, xy = parameters
    half = (xx + yy + zz) / 2
    return np.array(
        [
            [half - xx, -xy, -xz, hx],
            [-xy, half - yy, -yz, hy],
            [-xz, -yz, half - zz, hz],
            [hx, hy, hz, m],
        ]
    )


def slsqp(problem):
    """The same problem over a plain lower triangular factor, by SciPy; constraints of regions as
    they are."""
    lower = np.tril_indices(4)
    L = np.linalg.cholesky(problem.reference.pseudo_inertia)
    T, scale = problem.from_whitened, max(1.0, np.abs(problem.to_whitened @ problem.estimate).max())

    def parameters(x):
        C = np.zeros((4, 4))
        C[lower] = x
        return T @ svec(C @ C.T + problem.margin * np.eye(4))

    def cost(x):
        d = parameters(x) - problem.estimate
        return d @ problem.information @ d / 2

    weight = cost(np.sqrt(scale) * np.eye(4)[lower])
    constraints = [
        {
            "type": "ineq",
            "fun": (
                lambda x, Q=Q: (
                    np.trace(pseudo_inertia(parameters(x)) @ Q) / np.trace(L @ L.T @ Q @ Q)
                )
            ),
        }
        for Q in problem.conditions.values()
    ]
    found = [
        minimize(
            lambda x: cost(x) / weight,
            start[lower],
            method="SLSQP",
            constraints=constraints,
            options={"ftol": 1e-15, "maxiter": 3000},
        )
        for start in (np.eye(4), np.sqrt(scale) * np.eye(4))
    ]
    return min(cost(f.x) for f in found)


@pytest.mark.parametrize("seed", range(4))
def test_an_estimate_that_is_a_body_stays_as_it_is(seed):
    rng = np.random.default_rng(seed)
    for _ in range(10):
        problem, body, _ = random_problem(rng, step=0.0)
        problem = BodyProblem(body.parameters, problem.information, problem.reference)
        found = solve(problem)
        np.testing.assert_array_equal(found.parameters, body.parameters)
        assert (found.misfit, found.binding, found.status) == (0.0, (), "unchanged")


@pytest.mark.integration
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "settings", [{}, {"spread": 3.0}, {"step": 30.0}, {"untold": 4}, {"spread": 2.0, "untold": 7}]
)
def test_two_methods_agree_and_the_result_is_a_body(seed, settings):
    rng = np.random.default_rng(seed)
    for _ in range(12):
        problem, _, _ = random_problem(rng, **settings)
        found = solve(problem)
        assert found.disagreement <= AGREEMENT
        assert found.body.is_physical
        W = whitener(problem.reference)(pseudo_inertia(found.parameters))
        assert np.linalg.eigvalsh(W)[0] > problem.margin * (1 - 1e-6) - 1e-12 * np.abs(W).max()


@pytest.mark.integration
@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 6])
def test_the_optimum_is_that_of_scipy_on_a_plain_factor(seed):
    problem, _, points = random_problem(np.random.default_rng(seed), spread=0.5, step=2.0)
    if seed % 2:
        center = points.mean(axis=0)
        problem = BodyProblem(
            problem.estimate,
            problem.information,
            problem.reference,
            regions=[Box(center - np.ptp(points, axis=0), center + np.ptp(points, axis=0))],
        )
    found = solve(problem)
    assert found.status == "boundary"
    oracle = slsqp(problem)
    objective = found.misfit / 2 + found.prior
    assert objective == pytest.approx(
        oracle, rel=1e-4
    )  # SLSQP stops early where the factor is singular
    assert objective <= oracle * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_conditions_of_karush_kuhn_and_tucker(seed):
    rng = np.random.default_rng(seed)
    problem, _, points = random_problem(rng, spread=1.0)
    size = np.ptp(points, axis=0)
    region = Box(points.mean(axis=0) - size / 2, points.mean(axis=0) + size / 2)
    problem = BodyProblem(
        problem.estimate, problem.information, problem.reference, regions=[region]
    )
    found = solve(problem)
    multipliers = {b.name: b.multiplier for b in found.binding if b.plane is None}
    L = np.linalg.cholesky(problem.reference.pseudo_inertia)
    X = whitener(problem.reference)(pseudo_inertia(found.parameters)) - problem.margin * np.eye(4)
    gradient = problem.from_whitened.T @ problem.information @ (found.parameters - problem.estimate)
    for name, Q in problem.conditions.items():
        row = svec(L.T @ Q @ L) / np.linalg.norm(L.T @ Q @ L)
        slack = row @ svec(X + problem.margin * np.eye(4))
        assert slack >= -1e-12
        multiplier = multipliers.get(name, 0.0)
        assert multiplier >= 0
        assert multiplier * slack <= 1e-9 * (1 + found.misfit)
        gradient = gradient - multiplier * row
    dual = smat(gradient)  # of X >= 0
    size = np.abs(dual).max()
    assert np.linalg.eigvalsh(dual)[0] >= -1e-7 * size
    assert np.abs(X @ dual).max() <= 1e-6 * size * np.abs(X).max()


@pytest.mark.parametrize("seed", range(6))
def test_regions_hold_and_binding_ones_are_named(seed):
    rng = np.random.default_rng(seed)
    body, points = cloud(rng, 50.0, 2.0)
    low, high = points.min(axis=0), points.max(axis=0)
    information = np.diag([1e2, *[1e2] * 3, *[1.0] * 6])
    far = Inertia(50.0, high + 2.0 * np.eye(3)[0], body.inertia)
    found = solve(
        BodyProblem(far.parameters, information, body, regions=[Box(low, high, name="frame")])
    )
    assert "frame, x" in [b.name for b in found.binding]
    assert "frame, x" in " ".join(map(str, found.binding))
    S, c = found.body.pseudo_inertia[:3, :3], found.body.center_of_gravity
    for i in range(3):
        assert low[i] <= c[i] <= high[i]
        # Second moments of mass between two planes: integral of (x - low)(high - x) dm >= 0.
        inside = (
            -S[i, i]
            + (low[i] + high[i]) * c[i] * found.body.mass
            - low[i] * high[i] * found.body.mass
        )
        assert inside >= -1e-9 * found.body.mass
    ball = Ellipsoid(np.zeros(3), np.full(3, 1.5))
    found = solve(BodyProblem(far.parameters, information, body, regions=[ball]))
    assert [b.name for b in found.binding if b.plane is None] == ["ellipsoid"]
    assert np.trace(found.body.pseudo_inertia[:3, :3]) <= 1.5**2 * found.body.mass * (1 + 1e-9)


def test_every_body_within_a_region_meets_its_conditions():
    rng = np.random.default_rng(1)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    ellipsoid = Ellipsoid(np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.0, 2.0]), R)
    on_edge = R @ (ellipsoid.semi_axes * np.array([0.6, 0.8, 0.0])) + ellipsoid.center
    box = Box(np.array([0.0, -1.0, 2.0]), np.array([1.0, 1.0, 5.0]))
    for region, point in ((ellipsoid, on_edge), (box, box.upper)):
        r = np.append(point, 1.0)
        for Q in region.conditions.values():
            assert r @ Q @ r == pytest.approx(0.0, abs=1e-12)
            inside = np.append(
                0.5
                * (
                    point
                    + (ellipsoid.center if region is ellipsoid else (box.lower + box.upper) / 2)
                ),
                1,
            )
            assert inside @ Q @ inside > 0


def test_no_body_in_regions_that_do_not_meet():
    body, _ = cloud(np.random.default_rng(0))
    apart = [
        Box(np.full(3, -2.0), np.full(3, -1.0), name="one"),
        Box(np.full(3, 3.0), np.full(3, 4.0), name="other"),
    ]
    far = body.parameters * [1, 9, 9, 9, 1, 1, 1, 1, 1, 1]
    with pytest.raises(
        InputError, match="regions: expected at least one body with its mass in all of them"
    ):
        solve(BodyProblem(far, np.eye(10), body, regions=apart))


@pytest.mark.parametrize("seed", range(4))
def test_the_prior_pulls_to_the_nominal_body_by_its_weight(seed):
    rng = np.random.default_rng(seed)
    problem, nominal, _ = random_problem(rng, spread=0.5)
    free = solve(problem)
    distances = []
    for weight in (1e-6, 1e-2, 1.0, 1e2, 1e6):
        found = solve(
            BodyProblem(
                problem.estimate,
                problem.information,
                problem.reference,
                nominal=nominal,
                prior_weight=weight,
            )
        )
        assert found.disagreement <= AGREEMENT
        ratio = np.linalg.solve(nominal.pseudo_inertia, found.body.pseudo_inertia)
        divergence = np.trace(ratio) - np.log(np.linalg.det(ratio)) - 4
        assert found.prior == pytest.approx(weight * divergence, rel=1e-6, abs=1e-9)
        distances.append(divergence)
        if weight == 1e-6:
            assert found.misfit == pytest.approx(free.misfit, rel=1e-2, abs=1e-2)
    assert (np.diff(distances) < 0).all()
    assert distances[-1] < 1e-6


def test_the_gradient_vanishes_at_an_inner_optimum_of_the_prior():
    problem, nominal, _ = random_problem(np.random.default_rng(3), spread=0.5)
    problem = BodyProblem(
        problem.estimate, problem.information, problem.reference, nominal=nominal, prior_weight=1.0
    )
    found = solve(problem)
    T, L = problem.from_whitened, np.linalg.cholesky(problem.reference.pseudo_inertia)
    P = pseudo_inertia(found.parameters)
    pull = L.T @ (np.linalg.inv(nominal.pseudo_inertia) - np.linalg.inv(P)) @ L
    data = T.T @ problem.information @ (found.parameters - problem.estimate)
    np.testing.assert_allclose(data, -svec(pull), atol=1e-6 * np.abs(data).max())


@pytest.mark.parametrize("kilograms", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize("metres", [1.0, 1e-3, 1e2])
def test_units_do_not_matter(kilograms, metres):
    problem, _, points = random_problem(np.random.default_rng(5), spread=2.0)
    unit = kilograms * np.array([1.0, *[metres] * 3, *[metres**2] * 6])
    reference = Inertia.from_parameters(problem.reference.parameters * unit)
    region = Box(points.min(axis=0), points.max(axis=0))
    scaled = Box(metres * region.lower, metres * region.upper)
    one = solve(
        BodyProblem(problem.estimate, problem.information, problem.reference, regions=[region])
    )
    other = solve(
        BodyProblem(
            problem.estimate * unit,
            problem.information / np.outer(unit, unit),
            reference,
            regions=[scaled],
        )
    )
    assert one.misfit == pytest.approx(other.misfit, rel=1e-6)
    difference = problem.to_whitened @ (other.parameters / unit - one.parameters)
    assert np.abs(difference).max() < 1e-5 * np.abs(problem.to_whitened @ one.parameters).max()
    assert [b.name for b in one.binding] == [b.name for b in other.binding]


@pytest.mark.parametrize("seed", range(6))
def test_what_data_do_not_tell_may_be_anything(seed):
    rng = np.random.default_rng(seed)
    body, _ = cloud(rng, 100.0, 1.0)
    told = np.arange(10) < 4
    information = np.diag(np.where(told, 1e4, 0.0))
    one = solve(BodyProblem(np.where(told, body.parameters, 0.0), information, body))
    other = solve(
        BodyProblem(np.where(told, body.parameters, 1e12 * rng.normal(size=10)), information, body)
    )
    assert one.body.is_physical
    assert one.misfit == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(one.parameters[told], body.parameters[told], rtol=1e-6)
    np.testing.assert_allclose(other.parameters, one.parameters, rtol=1e-5, atol=1e-4)
    # Among those that fit equally well, the one nearest to the reference.
    np.testing.assert_allclose(one.parameters, body.parameters, rtol=1e-5, atol=1e-4)


def test_no_information_at_all_gives_the_reference():
    body, _ = cloud(np.random.default_rng(2))
    found = solve(BodyProblem(np.full(10, -1.0), np.zeros((10, 10)), body))
    np.testing.assert_allclose(
        found.parameters, body.parameters, atol=1e-6 * np.abs(body.parameters).max()
    )
    assert found.misfit == 0.0


@pytest.mark.parametrize("seed", range(8))
def test_a_mass_known_a_million_times_better(seed):
    rng = np.random.default_rng(seed)
    body, _ = cloud(rng, 200.0, 1.0)
    sigma = np.array([200.0 / MILLION, *[20.0] * 3, *[40.0] * 6])
    found = solve(
        BodyProblem(body.parameters + sigma * rng.normal(size=10) * 3, np.diag(sigma**-2), body)
    )
    assert found.disagreement <= AGREEMENT
    assert found.body.mass == pytest.approx(200.0, rel=20 / MILLION)


def table(examples):
    values = json.loads((examples / "table-iii" / "estimate.json").read_text())
    return Inertia.from_dict(values["estimates"]["two-step"]), Inertia.from_dict(values["nominal"])


def test_table_iii_and_the_nearest_body(examples):
    estimate, nominal = table(examples)
    found = nearest_body(estimate, nominal)
    assert found.excess == pytest.approx(4.2, abs=0.05)
    assert np.abs(found.axis @ estimate.inertia @ found.axis) == pytest.approx(103.26, abs=0.01)
    assert found.solution.body.is_physical
    assert found.solution.body.triangle_margin == pytest.approx(0.0, abs=0.01)
    # In the whitened Frobenius norm the nearest positive matrix keeps the eigenvectors and lifts
    # what lies below.
    W = whitener(nominal)(estimate.pseudo_inertia)
    values, vectors = np.linalg.eigh(W)
    lifted = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    np.testing.assert_allclose(
        whitener(nominal)(found.solution.body.pseudo_inertia), lifted, atol=1e-7
    )
    assert found.distance == pytest.approx(1e-6 - values[0], rel=1e-6)
    assert "4.204 kg m^2 more than the sum of the others" in str(found)
    (binding,) = found.solution.binding
    assert np.linalg.norm(binding.plane[:3]) == pytest.approx(1.0)
    # Flat: the second moment about that plane is about nothing.
    q = np.append(binding.plane[:3], -binding.plane[3])
    assert q @ found.solution.body.pseudo_inertia @ q < 1e-3
    assert "plane" in str(binding)


def test_distance_in_sigmas_and_without_reference(examples):
    estimate, nominal = table(examples)
    sigma = np.array([1.0, *[1.0] * 3, *[3.0] * 6])
    found = nearest_body(estimate, nominal, covariance=np.diag(sigma**2))
    difference = (found.solution.parameters - estimate.parameters) / sigma
    assert found.unit == "sigma"
    assert found.distance == pytest.approx(np.linalg.norm(difference), rel=1e-6)
    assert nearest_body(estimate).solution.body.is_physical
    assert nearest_body(nominal).distance == 0.0
    assert nearest_body(nominal).excess < 0
    with pytest.raises(InputError, match="covariance: expected a positive definite matrix"):
        nearest_body(estimate, nominal, covariance=np.zeros((10, 10)))


def test_covariance_is_that_of_information_as_if_nothing_bound():
    rng = np.random.default_rng(7)
    reference, _ = cloud(rng, 10.0, 1.0)
    D = BodyProblem(reference.parameters, np.zeros((10, 10)), reference).to_whitened
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    edge = svec(turn @ np.diag([-1e-3, 0.8, 1.0, 1.5]) @ turn.T)
    F = np.diag(10 ** rng.uniform(0, 1, 10)) @ np.linalg.qr(rng.normal(size=(10, 10)))[0] @ D
    problem = BodyProblem(np.linalg.solve(D, edge), F.T @ F, reference)
    found = solve(problem)
    assert len(found.binding) == 1
    whole = covariance(problem, found)
    np.testing.assert_allclose(
        D @ whole @ D.T, D @ np.linalg.inv(problem.information) @ D.T, rtol=1e-6, atol=1e-9
    )


def moved(solver, by):
    """A solver that ends elsewhere."""

    def wrong(whitened):
        end = solver(whitened)
        return end._replace(z=end.z + by)

    return wrong


def failing(whitened):
    raise np.linalg.LinAlgError


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("which", ["newton", "semidefinite_programme"])
@pytest.mark.parametrize("far", [1e-3, np.nan])
def test_where_the_solvers_differ_the_better_one_counts_and_it_is_said(
    monkeypatch, seed, which, far
):
    problem, _, _ = random_problem(np.random.default_rng(seed))
    right = solve(problem)
    assert right.remark is None
    solver = getattr(consistent_body, which)
    monkeypatch.setattr(consistent_body, which, moved(solver, far))
    found = solve(problem)
    assert found.disagreement > AGREEMENT
    assert "known less exactly than usual" in found.remark
    F = problem.root_information
    distance = np.linalg.norm(F @ (found.parameters - right.parameters))
    assert distance <= AGREEMENT * (1 + np.sqrt(right.misfit))
    assert found.body.is_physical
    assert [each.name for each in found.binding] == [each.name for each in right.binding]


def test_the_programme_knows_what_regions_cost_as_newton_does(monkeypatch):
    problem, _, points = random_problem(np.random.default_rng(5), spread=0.5, step=2.0)
    center, size = points.mean(axis=0), np.ptp(points, axis=0)
    problem = replace(problem, regions=(Box(center - 0.3 * size, center + 0.3 * size),))
    right = solve(problem)
    assert [each.name for each in right.binding] == ["pseudo-inertia", "box, x", "box, y"]
    monkeypatch.setattr(consistent_body, "newton", failing)
    found = solve(problem)
    assert found.disagreement == np.inf
    assert [each.name for each in found.binding] == [each.name for each in right.binding]
    for one, other in zip(found.binding, right.binding, strict=True):
        assert one.multiplier == pytest.approx(other.multiplier, rel=1e-6)


def test_where_neither_solver_ends_at_a_body_the_error_says_what_to_do(monkeypatch):
    problem, _, _ = random_problem(np.random.default_rng(0))
    for name in ("newton", "semidefinite_programme"):
        monkeypatch.setattr(consistent_body, name, failing)
    with pytest.raises(SteelyardError, match="give a reference body of about the same size"):
        solve(problem)
    region = Box(np.full(3, -1.0), np.full(3, 1.0))
    with pytest.raises(InputError, match="regions: expected some near the body"):
        solve(replace(problem, regions=(region,)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"information": -np.eye(10)},
            "information: expected a symmetric positive semidefinite matrix",
        ),
        ({"information": np.eye(10) + np.eye(10, k=1)}, "information: expected a symmetric"),
        ({"information": np.ones((10, 10)) * 2 - np.eye(10)}, "found a negative eigenvalue"),
        ({"estimate": np.zeros(9)}, "estimate: expected shape 10"),
        ({"margin": 0.0}, "margin: expected a number between 0 and 1"),
        ({"prior_weight": 1.0}, "prior_weight: expected 0, or more with a nominal body"),
        (
            {"reference": Inertia(-1.0, np.zeros(3), np.eye(3))},
            "reference: expected a body that can exist",
        ),
    ],
)
def test_what_is_no_problem_is_refused(change, message):
    values = {
        "estimate": np.ones(10),
        "information": np.eye(10),
        "reference": Inertia(1.0, np.zeros(3), np.eye(3)),
    }
    with pytest.raises(ValueError, match=message):
        BodyProblem(**(values | change))


def test_regions_are_checked():
    with pytest.raises(ValueError, match="box: expected lower < upper"):
        Box(np.ones(3), np.zeros(3))
    with pytest.raises(ValueError, match="ellipsoid: expected positive semi-axes"):
        Ellipsoid(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="ellipsoid: expected a rotation"):
        Ellipsoid(np.zeros(3), np.ones(3), 2 * np.eye(3))
