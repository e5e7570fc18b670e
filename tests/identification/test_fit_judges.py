"""Whether a fit is one: scales, minima that are none, and a chi^2 that the data cannot bear."""

import warnings

import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
import pytest

import jaxrod

Positive = jaxrod.Positive
X = np.arange(1.0, 9.0)


def pitch(p):
    """Of a steel cone whose modulus is given as an offset in pascals."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.02), 2e11 + p["offset"], 7800.0)
    return jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 3)


@pytest.fixture(scope="module")
def measured():
    return np.asarray(pitch({"offset": 1e10}))


def _lowest_around(model, data, sigma, parameters):
    """Least chi^2 on the coordinate lines through a point, from 1e-8 to 10 of each parameter."""
    lengths = np.geomspace(1e-8, 10.0, 46)
    tried = [
        {**parameters, name: value * (1 + sign * length)}
        for name, value in parameters.items()
        for sign in (1, -1)
        for length in lengths
    ]
    return min(float(np.sum(((np.asarray(model(p)) - data) / sigma) ** 2)) for p in tried)


# ---- scales


@pytest.mark.parametrize("start", [0.0, 1.0, 1e-9, 1e6, -5e10, 1e11])
def test_an_offset_in_pascals_from_anywhere(measured, start):
    """1e10 +- 5.5e7 Pa, the sensitivity by hand: f goes as the root of the modulus, so sigma / (f / 2 E)."""
    found = jaxrod.fit(pitch, measured, 1.0, {"offset": start})
    assert found.converged and found.steps < 50 and not found.doubts
    assert float(found.parameters["offset"]) == pytest.approx(1e10, rel=1e-8)
    by_hand = 2 * 2.1e11 / np.linalg.norm(measured)
    assert float(found.standard_errors["offset"]) == pytest.approx(by_hand, rel=1e-6)
    assert found.chi_square < 1e-12 and found.p_value == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("solver", "digits"),
    [
        (optx.BFGS(1e-8, 1e-8), 1e-8),
        (optx.GaussNewton(1e-8, 1e-8), 1e-8),
        (optx.Dogleg(1e-8, 1e-8), 1e-8),
        (optx.LevenbergMarquardt(1e-2, 1e-2), 1e-5),  # a loose one goes on until it is there
        (optx.NelderMead(1e-8, 1e-8), 1e-6),
        (optax.adam(0.05), 1e-5),
        (optax.sgd(0.3), 1e-5),
    ],
    ids=["BFGS", "GaussNewton", "Dogleg", "loose", "NelderMead", "adam", "sgd"],
)
def test_an_offset_from_zero_by_any_solver(measured, solver, digits):
    found = jaxrod.fit(pitch, measured, 1.0, {"offset": 0.0}, solver=solver)
    assert found.converged and found.chi_square < 1e-6
    assert float(found.parameters["offset"]) == pytest.approx(1e10, rel=digits)


@pytest.mark.parametrize("sigma", [1e-13, 1e-6, 1.0, 1e9])
def test_exact_data_end_at_rounding(measured, sigma):
    """Whatever the standard deviation: below rounding the residuals are large, and no step leads down."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a sigma below rounding is one that chi^2 does not bear
        found = jaxrod.fit(pitch, measured, sigma, {"offset": 0.0})
        there = jaxrod.fit(pitch, measured, sigma, {"offset": 1e10})
    assert found.converged and found.steps < 100
    assert float(found.parameters["offset"]) == pytest.approx(1e10, rel=1e-8)
    assert there.converged and there.steps < 40


def test_data_in_float32(measured):
    """It computes in JAX's default type."""
    single = jaxrod.fit(pitch, measured.astype(np.float32), np.float32(1.0), {"offset": np.float32(0.0)})
    assert single.converged and single.residuals.dtype == single.parameters["offset"].dtype == jnp.float64
    assert float(single.parameters["offset"]) == pytest.approx(1e10, rel=1e-5)

    def ring(p):
        rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), p["young"], 1200.0)
        return jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 2)

    found = jaxrod.fit(ring, np.array([19.24, 67.42], np.float32), 0.1, {"young": Positive(3e7)})
    assert found.converged and float(found.parameters["young"]) == pytest.approx(9.999e6, rel=1e-4)


# ---- minima, and what is none


@pytest.mark.parametrize(
    ("model", "data", "start", "chi_square"),
    [
        (lambda p: p["p"][None] ** 2, [4.0], {"p": 0.0}, 0.0),  # a maximum of chi^2
        (lambda p: 5 * (1 + (p["p"][None] / 1e9) ** 2), [10.0], {"p": 0.0}, 0.0),  # in pascals
        (lambda p: p["p"][None] ** 4, [4.0], {"p": 0.0}, 0.0),  # a flat one
        (lambda p: jnp.stack([jnp.cos(p["p"])] * 2), [0.6, 0.5], {"p": 0.0}, 0.5),
        (lambda p: jnp.stack([p["a"] * p["b"], p["a"] - p["b"]]), [3.0, 0.0], {"a": 0.0, "b": 0.0}, 0.0),  # a saddle
        (
            lambda p: 1 / (1 + (X - 4 - p["m"]) ** 2) + 1 / (1 + (X - 4 + p["m"]) ** 2),
            1 / (1 + (X - 7) ** 2) + 1 / (1 + (X - 1) ** 2),
            {"m": 0.0},  # two lines that coincide
            0.0,
        ),
    ],
)
def test_a_start_at_a_stationary_point_that_is_no_minimum(model, data, start, chi_square):
    """J^T J says nothing of them; the search leaves them for a minimum."""
    found = jaxrod.fit(model, data, 0.1, start)
    assert found.converged and float(found.chi_square) == pytest.approx(chi_square, abs=1e-8)


@pytest.mark.parametrize(
    ("model", "data", "start"),
    [
        (lambda p: p["a"] * jnp.array([1.0, 2.0]), [-1.0, -2.0], {"a": Positive(1.0)}),
        (lambda p: jnp.tanh(p["a"] * jnp.array([1.0, 0.5])), [1.5, 1.2], {"a": Positive(1.0)}),
        (lambda p: jnp.tanh(p["a"] * jnp.array([1.0, 0.5])), [1.5, 1.2], {"a": 1.0}),
    ],
    ids=["to zero", "without bound", "without bound, plain"],
)
@pytest.mark.parametrize("max_steps", [None, 3000])
def test_a_parameter_that_runs_off_has_not_converged(model, data, start, max_steps):
    with pytest.warns(UserWarning, match="did not converge in"):
        found = jaxrod.fit(model, data, 0.1, start, max_steps=max_steps)
    assert not found.converged and "did not converge" in str(found)


def test_a_model_that_is_not_finite_on_the_way():
    """Solvers that refuse a step find the minimum; one that does not says where it failed, and stays at the start."""

    def model(p):
        return jnp.sqrt(p["a"] - 1) * jnp.array([1.0, 2.0])

    for solver in (None, optx.BFGS(1e-8, 1e-8)):
        found = jaxrod.fit(model, [0.1, 0.21], 0.01, {"a": 50.0}, solver=solver)
        assert found.converged and float(found.parameters["a"]) == pytest.approx(1 + 0.104**2, rel=1e-7)
    with pytest.warns(UserWarning, match="the model is not finite where it went"):
        found = jaxrod.fit(model, [0.1, 0.21], 0.01, {"a": 50.0}, solver=optx.GaussNewton(1e-8, 1e-8))
    assert not found.converged and float(found.parameters["a"]) == 50.0


def test_more_parameters_than_data():
    """Any solver ends on the curve of answers, and says along which factor it runs."""

    def model(p):
        return jnp.stack([p["a"] + p["b"], p["b"] * p["c"]])

    for solver in (None, optx.GaussNewton(1e-8, 1e-8), optx.BFGS(1e-8, 1e-8)):
        with pytest.warns(UserWarning, match=r"the data do not tell a\^1 b\^-0\.\d+ c\^0\.\d+"):
            found = jaxrod.fit(model, [1.0, 2.0], 0.1, {"a": 0.3, "b": 5.0, "c": 0.0}, solver=solver)
        assert found.converged and found.chi_square < 1e-12 and found.degrees_of_freedom == 0


def test_a_parameter_without_influence():
    with pytest.warns(UserWarning, match="the data do not tell b"):
        found = jaxrod.fit(lambda p: p["a"] * X + 0 * p["b"], 2 * X, 0.1, {"a": 0.0, "b": 5.0})
    assert found.converged and float(found.parameters["a"]) == pytest.approx(2.0)
    assert float(found.parameters["b"]) == 5.0 and np.isinf(found.standard_errors["b"])
    assert found.degrees_of_freedom == 7


@pytest.mark.parametrize(
    "solver",
    [None, optx.Dogleg(1e-6, 1e-6), optx.BFGS(1e-3, 1e-3), optax.adam(0.1)],
    ids=["default", "Dogleg", "BFGS", "adam"],
)
def test_converged_is_a_minimum_on_every_coordinate_line(solver):
    """Decay with noise: no point on either line through the answer has a lower chi^2."""
    noise = 0.01 * np.array([1, -1, 0.5, 0.3, -0.7, 0.2, 1.2, -0.3])
    data = 5 * np.exp(-0.7 * X) + noise

    def model(p):
        return p["a"] * jnp.exp(-p["k"] * X)

    found = jaxrod.fit(model, data, 0.01, {"a": 1.0, "k": Positive(0.1)}, solver=solver)
    assert found.converged and not found.doubts
    answer = {name: float(x) for name, x in found.parameters.items()}
    assert _lowest_around(model, data, 0.01, answer) > float(found.chi_square) * (1 - 1e-5)
    assert found.p_value == pytest.approx(0.702, abs=0.001)  # chi^2 = 3.812 of 6


def test_sigma_that_is_far_too_large_is_no_excuse_to_stop():
    """Millimetres beside a standard deviation of one."""
    found = jaxrod.fit(
        lambda p: 1e-3 * p["a"] * jnp.exp(-p["k"] * X), 5e-3 * np.exp(-0.7 * X), 1.0, {"a": 1.0, "k": Positive(0.1)}
    )
    assert found.converged
    assert [float(found.parameters[name]) for name in ("a", "k")] == pytest.approx([5.0, 0.7], rel=1e-6)


# ---- chi^2


def test_two_rods_that_disagree():
    """Aluminium, free at both ends, heard at 1670 Hz (1.52 m) and 2000 Hz (1.21 m).

    One is out of tune with the other by 5 %.  By hand: f = sqrt(E / rho) / 2 L, so a least-squares line through zero in
    sqrt(E), and chi^2 = (f1 L1 - f2 L2)^2 / (L1^2 + L2^2).
    """

    def two_rods(p):
        rods = [jaxrod.Rod(length, jaxrod.Uniform(0.006), p["young"], 2700.0) for length in (1.52, 1.21)]
        scenes = [jaxrod.System(rod, jaxrod.Flight()) for rod in rods]
        return jnp.stack([jaxrod.continuum.natural_frequencies(scene, 1)[0] for scene in scenes])

    with pytest.warns(UserWarning, match=r"chi\^2 is 3714 for 1 degree of freedom: the model or sigma is wrong"):
        found = jaxrod.fit(two_rods, [1670.0, 2000.0], 1.0, {"young": Positive(5e10)})
    assert found.converged and found.p_value < 1e-300 and found.degrees_of_freedom == 1
    by_hand = (1670 * 1.52 - 2000 * 1.21) ** 2 / (1.52**2 + 1.21**2)
    assert float(found.chi_square) == pytest.approx(by_hand, rel=1e-9)
    assert float(found.parameters["young"]) == pytest.approx(6.567e10, rel=1e-4)
    assert float(found.standard_errors["young"]) == pytest.approx(5e7, rel=0.01)
    assert "chi^2 is 3714 for 1 degree of freedom: the model or sigma is wrong" in str(found)


@pytest.mark.parametrize("chi_square", [1.0, 23.0, 24.5])
def test_only_an_unbearable_chi_square_is_warned_of(chi_square):
    """Of one degree of freedom 1e-6 is at chi^2 = 23.93, which is 4.89 standard deviations."""
    apart = np.sqrt(2 * chi_square)  # of two data that should be equal
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = jaxrod.fit(lambda p: jnp.stack([p["a"], p["a"]]), [1.0, 1.0 + apart], 1.0, {"a": 0.0})
    assert found.converged and float(found.chi_square) == pytest.approx(chi_square)
    assert bool(found.doubts) == bool(said) == (chi_square > 23.93)


def test_as_many_parameters_as_data_that_miss_them():
    """Freudenstein and Roth's local minimum: chi^2 = 48.98 with nothing left to explain it."""

    def model(p):
        x, y = p["x"], p["y"]
        return jnp.stack([-13 + x + ((5 - y) * y - 2) * y, -29 + x + ((y + 1) * y - 14) * y])

    with pytest.warns(UserWarning, match=r"chi\^2 is 48\.98 for"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="the data do not tell")  # it is singular there
        found = jaxrod.fit(model, [0.0, 0.0], 1.0, {"x": 0.5, "y": -2.0})
    assert found.converged and float(found.chi_square) == pytest.approx(48.98425, abs=1e-4)


# ---- what it refuses


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"data": None}, "data=None is not numbers"),
        ({"sigma": "a"}, "sigma='a' is not numbers"),
        ({"model": lambda p: None}, "model returned None"),
        ({"model": lambda p: p["b"] * X}, "model raised KeyError"),
        ({"max_steps": 0}, "max_steps=0 must be a"),
        ({"max_steps": 1.5}, "max_steps=1.5 must be a"),
        ({"start": {"a": 0.0}, "model": lambda p: jnp.sqrt(p["a"]) * X}, "derivative at the start that is not finite"),
    ],
)
def test_refusals(change, message):
    arguments = {"model": lambda p: p["a"] * X, "data": X, "sigma": 1.0, "start": {"a": 1.0}} | change
    with pytest.raises(ValueError, match=message):
        jaxrod.fit(**arguments)
