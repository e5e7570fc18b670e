"""Identification: what is found, how surely, and what the data cannot tell."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxrod


def frequencies(p, n=3):
    """Exact frequencies of the paper's cone, with some of its numbers to be found."""
    section = jaxrod.Cone(p.get("root", 0.02), p.get("tip", 0.02 * p.get("taper", 1.5)))
    rod = jaxrod.Rod(1.0, section, p.get("young", 1e7), p.get("density", 1200.0))
    return jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), n)


TARGET = {"young": 1e7, "taper": 1.5}
START = {"young": jaxrod.Positive(3e7), "taper": jaxrod.Positive(1.0)}


@pytest.mark.parametrize(
    ("solver", "digits"), [(None, 1e-9), (optax.adam(0.02), 1e-4)], ids=["Levenberg-Marquardt", "adam"]
)
def test_modulus_and_taper_from_frequencies(solver, digits):
    found = jaxrod.fit(frequencies, frequencies(TARGET), 0.1, START, solver=solver)
    assert found.converged
    for name, value in TARGET.items():
        assert float(found.parameters[name]) == pytest.approx(value, rel=digits)


def test_modulus_alone_from_the_contract():
    found = jaxrod.fit(
        lambda p: frequencies(p, 2), data=[19.24, 67.42], sigma=0.1, start={"young": jaxrod.Positive(3e7)}
    )
    assert float(found.parameters["young"]) == pytest.approx(1e7, rel=1e-3)


@pytest.mark.slow
def test_standard_errors_are_the_spread_of_repeated_measurements():
    """Linear error propagation against 40 noisy repetitions: their spread, within its own sampling error of 11 %."""
    rng, sigma = np.random.default_rng(0), 0.05
    exact = np.asarray(frequencies(TARGET))
    fits = [jaxrod.fit(frequencies, exact + sigma * rng.standard_normal(3), sigma, START) for _ in range(40)]
    for name in TARGET:
        spread = np.std([float(f.parameters[name]) for f in fits], ddof=1)
        assert float(fits[0].standard_errors[name]) == pytest.approx(spread, rel=0.35)


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ({"root": 0.02, "tip": 0.025}, "a common factor of root and tip"),
        ({"young": 2e7, "density": 1000.0}, "a common factor of density and young"),
    ],
)
def test_says_what_cannot_be_told_apart(start, said):
    start = {name: jaxrod.Positive(value) for name, value in start.items()}
    with pytest.warns(UserWarning, match=said):
        found = jaxrod.fit(frequencies, frequencies(TARGET), 0.1, start)
    assert said in found.unidentified[0] and said in str(found)
    assert all(np.isinf(error) for error in found.standard_errors.values())
    # What the data do tell is found: the ratio.
    p = found.parameters
    ratio, right = (p["tip"] / p["root"], 1.5) if "root" in start else (p["young"] / p["density"], 1e7 / 1200.0)
    assert float(ratio) == pytest.approx(right, rel=1e-6)


@pytest.mark.slow
def test_through_a_motion_reverse_mode():
    """The default adjoint of `simulate` is reverse-mode; `fit` notices."""

    def angles(p):
        rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), p["young"], 1200.0)
        system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
        return jaxrod.simulate(system, system.state(rate=p["rate"]), ts=jnp.linspace(0.05, 0.3, 6)).angle

    found = jaxrod.fit(
        angles, angles({"young": 1e7, "rate": 15.0}), 1e-3, {"young": jaxrod.Positive(1.1e7), "rate": 14.0}
    )
    assert float(found.parameters["young"]) == pytest.approx(1e7, rel=1e-7)
    assert float(found.parameters["rate"]) == pytest.approx(15.0, rel=1e-9)


def test_a_search_cut_short_says_so():
    with pytest.warns(UserWarning, match="did not converge in 3 steps"):
        found = jaxrod.fit(frequencies, frequencies(TARGET), 0.1, START, solver=optax.adam(1e-4), max_steps=3)
    assert not found.converged and "NOT converged" in str(found)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": 0.0}, r"sigma=\[0. 0. 0.\] must be positive"),
        ({"sigma": [0.1, 0.1]}, "one number or one for each of 3 data"),
        ({"data": [1.0, jnp.nan, 2.0]}, r"data=\[ 1. nan  2.\] must be finite"),
        ({"data": [1.0, 2.0]}, r"model returns shape \(3,\) but data has shape \(2,\)"),
        ({"start": {}}, "start={} holds no parameter"),
        ({"start": {"young": "soft"}}, r"start\['young'\]='soft' is not a number"),
        ({"start": {"young": -1.0}}, "young=-1 must be positive"),  # the rod's own answer
        ({"solver": "LM"}, "solver='LM' is no solver"),
    ],
)
def test_bad_input(change, message):
    arguments = {"data": [19.24, 67.42, 113.5], "sigma": 0.1, "start": START} | change
    with pytest.raises(ValueError, match=message):
        jaxrod.fit(frequencies, **arguments)


def test_positive_refuses_zero():
    with pytest.raises(ValueError, match=r"Positive\(value=\)=0 must be positive"):
        jaxrod.Positive(0.0)


def test_gradient_descent_by_hand():
    """The user's own loop: Optax on a gradient through the frequencies."""
    target = frequencies(TARGET)[0]
    optimiser = optax.adam(0.05)

    def loss(log_young):
        return (frequencies({"young": jnp.exp(log_young)})[0] - target) ** 2

    @jax.jit
    def step(x, state):
        updates, state = optimiser.update(jax.grad(loss)(x), state)
        return optax.apply_updates(x, updates), state

    x = jnp.log(2e7)
    state = optimiser.init(x)
    for _ in range(400):
        x, state = step(x, state)
    assert float(jnp.exp(x)) == pytest.approx(1e7, rel=1e-4)


def test_an_exact_fit_ends():
    """As many data as parameters: residuals of rounding alone, from which no step leads down; found by 9.0 of all data."""
    found = jaxrod.fit(
        lambda p: jnp.sqrt(p["young"] / 1150.0)[None] / 3.6,
        data=[9.0],
        sigma=0.1,
        start={"young": jaxrod.Positive(2e6)},
    )
    assert found.converged and found.steps <= 256
    assert float(found.parameters["young"]) == pytest.approx(1150 * (9.0 * 3.6) ** 2, rel=1e-12)
