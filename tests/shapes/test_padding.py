"""A rung in arrays of more shapes is that rung: its frequencies and its motion."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.accuracy.ladder import brought, first_shapes, padded, projected


@pytest.mark.parametrize("basis", [jaxrod.LoadRitz(2), jaxrod.LoadRitz(4), jaxrod.ForceRitz(3)], ids=repr)
@pytest.mark.parametrize("pivot", [None, pytest.param(0.4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("static", [False, True])
def test_the_same_motion(scene, basis, pivot, static):
    motion = jaxrod.Rotation() if pivot is None else jaxrod.Rotation(pivot)
    system = scene(motion, jaxrod.Ritz(1), gravity=9.81)
    start = system.state(rate=12.0, strain=0.02, strain_rate=0.3)
    how = {"ts": jnp.array([0.1, 0.3]), "solver": jaxrod.ABA864(), "n_steps": 400}
    runs = [jaxrod.simulate(*brought(system, start, x, static, 0.0), **how) for x in (basis, first_shapes(basis, 6))]
    np.testing.assert_allclose(runs[1].tip, runs[0].tip, atol=1e-10)
    np.testing.assert_allclose(runs[1].energy, runs[0].energy, rtol=1e-9)
    assert np.all(np.asarray(runs[1].states.amplitudes)[:, basis.n :] == 0)


def test_sizes():
    assert padded(jaxrod.LoadRitz(4)).n == 6 and padded(jaxrod.LoadRitz(9)).n == 12
    for alone in (jaxrod.Ritz(1), jaxrod.LoadRitz(1), jaxrod.QuasiStatic(jaxrod.LoadRitz(2))):
        assert padded(alone) is alone


@pytest.mark.parametrize("basis", [jaxrod.Ritz(1), jaxrod.LoadRitz(2), first_shapes(jaxrod.ForceRitz(2), 6)], ids=repr)
@pytest.mark.parametrize("motion", [jaxrod.Rotation(0.4), jaxrod.Flight()], ids=repr)
def test_projected_once(scene, basis, motion):
    """The same numbers, with no look at the rod."""
    system = scene(motion, basis, gravity=9.81)
    once, start = projected(system), system.state(rate=12.0, amplitudes=[0.02] + [0.0] * (basis.n - 1))
    for one, other in zip(jax.tree.leaves(once.body), jax.tree.leaves(system.body), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-15, atol=0)
    runs = [jaxrod.simulate(x, start, t1=0.2) for x in (system, once)]
    np.testing.assert_allclose(runs[1].tip, runs[0].tip, atol=1e-13)
    heavier = dataclasses.replace(system.rod, density=2 * system.rod.density)
    masses = [dataclasses.replace(x, rod=heavier).body.mass / x.body.mass for x in (system, once)]
    np.testing.assert_allclose(masses, [2.0, 1.0])


def test_what_has_no_projection_of_its_own(scene):
    for system in (scene(basis=jaxrod.QuasiStatic(jaxrod.LoadRitz(2))), scene(rod=jaxrod.Lumped(1.0, 0.5, 100.0, 1.0))):
        assert type(projected(system).basis) is type(system.basis)
