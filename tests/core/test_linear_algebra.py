"""Factorisations: no program holds a batched call of LAPACK, on which two devices wait for each other; derivatives."""

import os
import re
import subprocess
import sys

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from conftest import scene

import jaxrod
from jaxrod.core import linear_algebra

SWEEPS = """
import jaxrod
print(jaxrod.configure(devices=2, cache=None), flush=True)
import jax, jax.numpy as jnp

def frequencies(young):
    rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.02), young, 1200.0)
    return jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation(0.3)), 3)

def both(young):
    return frequencies(young), jax.jacrev(frequencies)(young)

young = jnp.geomspace(1e6, 1e8, 256)
for _ in range(20):
    f, slope = jaxrod.sweep(both, young)
assert abs(slope / f * young[:, None] * 2 - 1).max() < 1e-9
print("ended")
"""


@pytest.mark.slow
def test_sweeps_of_exact_frequencies_end():
    """Twenty in a row on two devices, values and gradients: before, every second process hung for ever."""
    flags = {"XLA_FLAGS": "", "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", SWEEPS], env=os.environ | flags, capture_output=True, text=True, timeout=600
    )
    assert run.returncode == 0, run.stderr
    assert "2 CPU devices" in run.stdout and "ended" in run.stdout


def batched(function):
    """The batched calls of LAPACK in the program of a function mapped over many moduli, and how many others there are."""
    program = jax.jit(jax.vmap(function)).lower(jnp.geomspace(1e6, 1e8, 64)).as_text()
    calls = re.findall(r"custom_call @(lapack_\w+).* : (\(.*)", program)
    return [call for call in calls if re.search(r"tensor<\d+x\d+x\d+x", call[1])], len(calls)


def test_the_look_for_batched_calls_sees_them():
    found, _ = batched(lambda x: jnp.linalg.svd(x * jnp.eye(3), compute_uv=False))
    assert len(found) == 1


def two(young, motion=None, basis=None):
    """Two shapes unless given: their matrices are factorised."""
    return scene(motion, basis or jaxrod.Ritz(2), gravity=9.81, young=young)


def exact_run(young):
    system = two(young)
    return jaxrod.continuum.simulate(system, system.state(), ts=jnp.array([0.1]), modes=4, error=False).angle[0]


def run(basis=None, **how):
    def end(young):
        system = two(young, basis=basis)
        return jaxrod.simulate(system, two(1e7, basis=basis).state(rate=5.0), t1=0.1, **how).angle[-1]

    return end


LEVEL = diffrax.Event(lambda t, y, args, **_: y.direction[1] - 0.5, optx.Newton(1e-12, 1e-12))
QUICK = {
    "exact": lambda E: jaxrod.continuum.natural_frequencies(two(E, jaxrod.Rotation(0.3)), 2)[1],
    "spinning": lambda E: jaxrod.continuum.spinning_frequencies(two(E), 5.0, 2, free=True)[1],
    "steady": lambda E: jaxrod.continuum.steady_spin(two(E), 5.0),
    "rungs": lambda E: jaxrod.natural_frequencies(two(E))[1],
    "critical": lambda E: jaxrod.critical_rate(two(E)),
    "bending": lambda E: jaxrod.model_limits(two(E)).bending_frequencies[0],
    "lateral": lambda E: jaxrod.model_limits(two(E)).lateral_inertia,
}
SLOW = {
    "equilibrium": lambda E: jaxrod.equilibrium(two(E, jaxrod.Spherical()), spin=2.0).strain,
    "modes": lambda E: jaxrod.modes(two(E)).frequency[1],
    "exact run": exact_run,
    "default": run(),
    "float32's condition": lambda E: run()(E.astype(jnp.float32)),
    "adaptive": run(solver=diffrax.Dopri8()),
    "static": run(jaxrod.QuasiStatic(jaxrod.Ritz(3))),
    "implicit": run(solver=diffrax.Kvaerno5()),
    "event": run(event=LEVEL),
}


@pytest.mark.parametrize("name", QUICK)
def test_no_batched_call(name):
    """Values, and first and second derivatives both ways."""
    f = QUICK[name]
    assert batched(f)[1] > 0
    for derivative in (f, jax.grad(f), jax.jacfwd(f), jax.grad(jax.grad(f)), jax.jacfwd(jax.grad(f))):
        assert not batched(derivative)[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_no_batched_call_of_runs(name):
    assert not batched(SLOW[name])[0]
    if name not in ("implicit", "event"):  # Diffrax differentiates their roots by a solver of its own choice
        assert not batched(jax.grad(SLOW[name]))[0]


@pytest.mark.slow
def test_no_batched_call_of_a_horizon():
    def growth(young):
        start = two(1e7).state(rate=5.0)
        return jaxrod.horizon(two(young), start, t1=0.1, tolerance=1e-3).growth_rate

    assert not batched(growth)[0]


# ---- derivatives


def a_matrix(shape, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape), rng.normal(size=shape), rng.normal(size=shape)


def check_derivatives(f, orders=2, rtol=1e-6):
    """Derivatives by t at 0: forwards, backwards and mixed, against central differences."""
    f = jax.jit(f)
    for order in range(orders):
        difference = (f(1e-5) - f(-1e-5)) / 2e-5
        forward, reverse = jax.jit(jax.jacfwd(f)), jax.jit(jax.jacrev(f))
        np.testing.assert_allclose(forward(0.0), difference, rtol=rtol, atol=rtol * np.abs(difference).max())
        np.testing.assert_allclose(reverse(0.0), forward(0.0), rtol=1e-9, atol=1e-10)
        f = reverse if order else forward


@pytest.mark.parametrize("shape", [(4, 4), (6, 4), (4, 6)])
def test_singular_values_and_vectors(shape):
    a, b, c = a_matrix(shape)

    def moving(t):
        return a + t * b + t**2 * c

    np.testing.assert_allclose(linear_algebra.singular_values(a, 3), np.linalg.svd(a)[1][:3], rtol=1e-13)
    u, sigma, v = linear_algebra.svd(a, 3)
    np.testing.assert_allclose(a @ v, u * sigma[None, :], atol=1e-13)
    check_derivatives(lambda t: linear_algebra.singular_values(moving(t), 3), orders=3)

    def shapes(t):
        u, _, v = linear_algebra.svd(moving(t), 3)
        return jnp.concatenate([jnp.abs(u).ravel(), jnp.abs(v).ravel()])

    check_derivatives(shapes)


def test_singular_values_beside_zeros_that_meet():
    """Half of the columns and rows are zero and stay so, as of a rod held inside."""
    a, b, c = (np.pad(x, ((0, 3), (0, 3))) for x in a_matrix((3, 3)))
    check_derivatives(lambda t: linear_algebra.singular_values(a + t * b + t**2 * c, 3))


def test_inverse_root():
    a, b, c = a_matrix((4, 4))

    def moving(t):
        x = a + t * b + t**2 * c
        return x @ x.T + jnp.eye(4)

    root = linear_algebra.inverse_root(moving(0.0))
    np.testing.assert_allclose(root @ root.T @ moving(0.0), np.eye(4), atol=1e-13)
    check_derivatives(lambda t: linear_algebra.inverse_root(moving(t)))
    assert np.all(np.isnan(linear_algebra.inverse_root(-jnp.eye(2))))


@pytest.mark.parametrize("shape", [(4, 4), (6, 4), (4, 6)])
def test_pseudo_inverse(shape):
    """Of a complex matrix, too, and of one whose rank is low and stays so."""
    a, b, c = a_matrix(shape)

    def whole(t):
        return a + t * b + 1j * t**2 * c

    def low(t):
        x = a + t * b + t**2 * c
        return x[:, :2] @ x[:2]

    np.testing.assert_allclose(linear_algebra.pinv(whole(0.1)), np.linalg.pinv(whole(0.1)), rtol=1e-11)
    check_derivatives(lambda t: jnp.concatenate([jnp.real(linear_algebra.pinv(whole(t))), linear_algebra.pinv(low(t))]))


@pytest.mark.slow
def test_an_implicit_solver_by_loops_answers_alike():
    """The stiff scene of `Kvaerno5` has the answer of the default."""
    system = two(1e7)
    start = system.state(rate=5.0)
    ends = [jaxrod.simulate(system, start, t1=0.1, solver=s).tip[-1] for s in (None, diffrax.Kvaerno5())]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
