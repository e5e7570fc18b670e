"""Legendre polynomials, integrals along the rod and their derivatives, which cost about as much backwards as forwards."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.rods.quadrature import Panels, legendre


@pytest.mark.parametrize("degree", [0, 1, 2, 18])
def test_legendre_polynomials(degree):
    """Values, first and second derivatives, one point after another and all at once."""
    x = jnp.array([-1.0, -0.3, 0.0, 0.9, 1.0])
    derivative = functools.partial(legendre, degree)
    for order in range(3):
        expected = np.stack([np.polynomial.Legendre.basis(k).deriv(order)(x) for k in range(degree + 1)])
        close = functools.partial(np.testing.assert_allclose, desired=expected, rtol=1e-11, atol=1e-9)
        close(jax.jit(jax.vmap(derivative, out_axes=1))(x))
        if order == 0:
            close(legendre(degree, x))
        derivative = jax.jacrev(derivative) if order else jax.jacfwd(derivative)


def test_a_derivative_takes_as_many_equations_for_any_degree():
    """The recurrence differentiated backwards is a sum over all paths down, which a compiler may write out."""
    x = jnp.linspace(-1.0, 1.0, 5)

    def equations(degree):
        tangent = jax.linearize(functools.partial(legendre, degree), x)[1]
        return len(jax.make_jaxpr(tangent)(x).eqns)

    assert equations(18) == equations(4) < 10


def test_an_integral_by_its_limits():
    """Of cos on panels whose ends move: by the upper limit cos, by a break between nothing."""

    def integral(ends, at):
        panels = Panels(ends, 12)
        return panels.antiderivative(jnp.cos(panels.s)[None], at)[0]

    ends, at = jnp.array([0.0, 0.3, 1.0]), jnp.array([0.1, 0.3, 0.7, 1.0])
    np.testing.assert_allclose(integral(ends, at), np.sin(at), rtol=1e-13)
    by_ends, by_limit = jax.jit(jax.jacrev(integral, argnums=(0, 1)))(ends, at)
    np.testing.assert_allclose(by_limit, np.diag(np.cos(at)), atol=1e-12)
    np.testing.assert_allclose(by_ends, np.array([[-1.0, 0.0, 0.0]] * 4), atol=1e-12)


def by_the_pivot(basis):
    def frequencies(pivot):
        rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.025), 1e7, 1200.0)
        return jaxrod.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation(pivot), basis))[:2]

    return jax.jit(frequencies)


def test_frequencies_by_the_pivot():
    """Known by central differences."""
    slope = jax.jit(jax.jacrev(by_the_pivot(jaxrod.LoadRitz(2))))(0.3)
    np.testing.assert_allclose(slope, [46.6178, -253.7592], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("basis", [jaxrod.LoadRitz(5), jaxrod.ForceRitz(5), jaxrod.Ritz(12)], ids=repr)
def test_frequencies_of_more_shapes_by_the_pivot(basis):
    """Backwards as forwards, and as central differences say."""
    frequencies = by_the_pivot(basis)
    slope = jax.jacrev(frequencies)(0.3)
    np.testing.assert_allclose(slope, jax.jacfwd(frequencies)(0.3), rtol=1e-9)
    np.testing.assert_allclose(slope, (frequencies(0.3 + 1e-5) - frequencies(0.3 - 1e-5)) / 2e-5, rtol=1e-6)
