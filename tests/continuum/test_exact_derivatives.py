"""Derivatives of the exact rod's runs: forwards, backwards and second ones right, or refused in one sentence."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod

FORWARDS = {"adjoint": diffrax.ForwardMode()}
AT = jnp.array([1.0, 5.0, 0.0])
ASIDE = jnp.diag(jnp.array([1e-4, 1e-4, 1e-6]))


def ends(x, **how):
    """Angle and tip by the modulus, the rate and an offset of the save times."""
    young, rate, offset = x
    rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.025), 1e6 * young, 1200.0)
    system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81)
    start, ts = system.state(rate=rate, strain=0.01), jnp.array([0.05, 0.1]) + offset
    sol = jaxrod.continuum.simulate(system, start, ts=ts, modes=2, error=False, **how)
    return jnp.concatenate([sol.angle, sol.tip_stretch])


def difference(f):
    columns = [(f(AT + h) - f(AT - h)) / (2 * h.sum()) for h in ASIDE]
    return np.stack(columns, axis=-1)


@pytest.mark.slow
def test_first_derivatives_both_ways():
    expected = difference(ends)
    np.testing.assert_allclose(jax.jacrev(ends)(AT), expected, rtol=1e-6)
    np.testing.assert_allclose(jax.jacfwd(lambda x: ends(x, **FORWARDS))(AT), expected, rtol=1e-6)


@pytest.mark.slow
def test_second_derivatives():
    first = jax.jit(jax.jacfwd(lambda x: ends(x, **FORWARDS)))
    expected = difference(first)
    np.testing.assert_allclose(jax.jacfwd(first)(AT), expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "derivative, how, words",
    [
        (jax.jacfwd, {}, "no forward derivative by default"),
        (jax.hessian, {}, "no forward derivative by default"),
        (lambda f: jax.jacrev(jax.jacrev(f)), {}, "no reverse derivative of a reverse"),
        (jax.jacrev, FORWARDS, "has no reverse derivative"),
    ],
)
def test_what_a_run_has_not_is_refused_in_one_sentence(derivative, how, words):
    with pytest.raises(ValueError, match=words):
        derivative(lambda x: ends(x, **how)[0])(AT)


def test_an_adjoint_of_another_type():
    with pytest.raises(ValueError, match="adjoint='forward' is no adjoint"):
        ends(AT, adjoint="forward")
