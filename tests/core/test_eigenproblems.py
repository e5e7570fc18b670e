"""Eigenproblems: right values and shapes, and derivatives that central differences confirm, where eigenvalues meet too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxrod
from jaxrod.core import linear_algebra

H = 1e-6


def pencil(n, seed=0):
    """Symmetric a, positive definite b, and a direction for each."""
    rng = np.random.default_rng(seed)
    a, b, da, db = (x + x.T for x in rng.normal(size=(4, n, n)))
    return a, b @ b + n * np.eye(n), da, db


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e15])
def test_values_and_shapes(scale):
    a, b, *_ = pencil(6)
    a, b = a * scale, b / scale
    w, v = linear_algebra.eigh(a, b)
    np.testing.assert_allclose(w, scipy.linalg.eigh(a, b, eigvals_only=True), rtol=1e-12)
    np.testing.assert_allclose(v.T @ b @ v, np.eye(6), atol=1e-13)
    np.testing.assert_allclose(a @ v, (b @ v) * np.asarray(w)[None, :], atol=1e-12 * np.abs(a).max() * np.abs(v).max())
    assert np.all(np.take_along_axis(np.asarray(v), np.argmax(np.abs(v), axis=0)[None], axis=0) > 0)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e15])
def test_derivatives(scale):
    """Against central differences, forward and reverse, for numbers of any size."""
    a, b, da, db = pencil(5)

    def both(t):
        w, v = linear_algebra.eigh((a + t * da) * scale, (b + t * db) / scale)
        return jnp.concatenate([w / scale**2, v.ravel() / np.sqrt(scale)])

    forward, reverse = jax.jacfwd(both)(0.0), jax.jacrev(both)(0.0)
    difference = (both(H) - both(-H)) / (2 * H)
    np.testing.assert_allclose(forward, difference, atol=1e-8)
    np.testing.assert_allclose(reverse, forward, rtol=1e-11, atol=1e-13)
    assert np.abs(forward).min() > 1e-6  # every number moves


def test_eigenvalues_that_meet():
    """The sum, and whatever is symmetric in them, has its derivative; nothing is NaN; others are as usual."""
    rng = np.random.default_rng(1)
    turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    a, da = turn @ np.diag([1.0, 2.0, 2.0, 5.0]) @ turn.T, rng.normal(size=(4, 4))
    da, b = da + da.T, np.eye(4)

    def values(t):
        return linear_algebra.eigh(a + t * da, b)[0]

    slope, difference = jax.jacfwd(values)(0.0), (values(H) - values(-H)) / (2 * H)
    np.testing.assert_allclose(slope[jnp.array([0, 3])], difference[jnp.array([0, 3])], atol=1e-7)
    assert float(slope[1:3].sum()) == pytest.approx(float(difference[1:3].sum()), abs=1e-7)
    np.testing.assert_allclose(jax.jacrev(values)(0.0), slope, rtol=1e-12)
    shapes = jax.jacrev(lambda t: linear_algebra.eigh(a + t * da, b)[1])(0.0)
    assert np.all(np.isfinite(shapes))

    def smooth(t):  # exp(-(a + t da)): a function of the matrix, whatever vectors span the plane of the two
        w, v = linear_algebra.eigh(a + t * da, b)
        return jnp.sum(jnp.exp(-w) * (v**2).sum(axis=0))

    assert float(jax.grad(smooth)(0.0)) == pytest.approx(float(smooth(H) - smooth(-H)) / (2 * H), abs=1e-7)


def test_a_rod_held_in_the_middle():
    """Both halves sound alike: repeated frequencies, whose derivatives by the modulus are f / 2E, and by the pivot opposed."""

    def frequencies(young, pivot):
        rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.025), young, 1200.0)
        return jaxrod.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation(pivot), jaxrod.Ritz(6)))

    f = frequencies(1e7, 0.5)
    np.testing.assert_allclose(f[::2], f[1::2], rtol=1e-12)
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jacobian(frequencies)(1e7, 0.5), f / 2e7, rtol=1e-9)
        by_pivot = jacobian(frequencies, argnums=1)(1e7, 0.5)
        assert np.all(np.isfinite(by_pivot))
        np.testing.assert_allclose(by_pivot[::2] + by_pivot[1::2], 0.0, atol=1e-6)


def test_general_matrices():
    """Values, and shapes up to their factor, of a matrix without symmetry."""
    rng = np.random.default_rng(2)
    a, da = rng.normal(size=(2, 5, 5))

    def both(t):
        w, v = linear_algebra.eig(a + t * da)
        order = jnp.argsort(w.real + 0.1 * w.imag)
        w, v = w[order], v[:, order] / v[0, order][None, :]
        return jnp.concatenate([w.real, w.imag, v.real.ravel(), v.imag.ravel()])

    w, v = linear_algebra.eig(a)
    np.testing.assert_allclose(a @ v, v * w[None, :], atol=1e-13)
    forward, difference = jax.jacfwd(both)(0.0), (both(H) - both(-H)) / (2 * H)
    np.testing.assert_allclose(forward, difference, atol=1e-7)
    np.testing.assert_allclose(jax.jacrev(both)(0.0), forward, rtol=1e-9, atol=1e-11)
    assert np.all(np.isfinite(jax.jacfwd(lambda t: linear_algebra.eig(jnp.eye(3) * (1 + t))[0].real)(0.0)))


@pytest.mark.slow
def test_modes_differentiate(cone):
    """Frequencies, growth and shapes of a spinning, viscous rod in space, by the modulus: with derivatives of its equilibrium."""

    @jax.jit
    def numbers(young):
        rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young, 1200.0)
        system = jaxrod.System(rod, jaxrod.Spherical(), jaxrod.Ritz(2), gravity=9.81, forces=[jaxrod.KelvinVoigt(1e-4)])
        modes = jaxrod.modes(system, jaxrod.equilibrium(system, spin=12.0))
        # but for the first, neutral one: round the vertical all places are alike
        shapes = jnp.abs(jnp.concatenate([modes.direction[1:].ravel(), modes.amplitudes[1:].ravel()]))
        return jnp.concatenate([modes.frequency, modes.growth, shapes])

    slope = jax.jit(jax.jacfwd(numbers))(1e7)
    difference = (numbers(1e7 + 1e3) - numbers(1e7 - 1e3)) / 2e3
    assert np.all(np.isfinite(slope))
    np.testing.assert_allclose(slope * 1e7, difference * 1e7, atol=2e-6)
    assert np.abs(slope * 1e7).max() > 1.0
