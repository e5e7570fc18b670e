"""A rung in arrays of more shapes is that rung: its frequencies and its motion."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.accuracy.ladder import brought, first_shapes, padded


@pytest.mark.parametrize("basis", [jaxrod.LoadRitz(2), jaxrod.LoadRitz(4), jaxrod.ForceRitz(3)], ids=repr)
@pytest.mark.parametrize("pivot", [None, 0.4])
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
