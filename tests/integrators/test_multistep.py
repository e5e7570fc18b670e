"""Symmetric multistep methods: of their order, on all flat scenes, and refused where they do not belong."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod
from jaxrod import QuinlanTremaine10, QuinlanTremaine12

METHODS = [QuinlanTremaine10(), QuinlanTremaine12()]


def _thrown(motion=None, gravity=9.81, forces=(), rate=15.0, **moving):
    system = scene(motion, gravity=gravity, forces=forces)
    return system, system.state(rate=rate, **moving)


def _tip(system, start, t1=0.5, **how):
    return jaxrod.simulate(system, start, t1=t1, **how).tip[-1]


def test_coefficients():
    """Those of the paper: consistent, symmetric, and stable to the phases it is known to be (about 2 pi / 15, 2 pi / 29)."""
    ten, twelve = METHODS
    for method in METHODS:
        second = sum(a * j**2 for j, a in enumerate(method.alphas)) / 2
        np.testing.assert_allclose(sum(method.weights), second, rtol=1e-12)
        assert method.weights == method.weights[::-1] and len(method.weights) == method.past
        np.testing.assert_allclose(sum(method.velocity), 0.5, rtol=1e-12)
    assert 0.40 < ten.stable_phase < 0.43 and 0.20 < twelve.stable_phase < 0.23


@pytest.mark.parametrize("method", METHODS, ids=["10", "12"])
def test_order(method):
    """Half as many steps again: the error falls with the power of the order."""
    system, start = _thrown()
    exact = _tip(system, start, tolerance=1e-12)
    few = 300 if method.accuracy == 10 else 360
    errors = [
        float(jnp.max(jnp.abs(_tip(system, start, solver=method, n_steps=n) - exact))) for n in (few, 3 * few // 2)
    ]
    assert errors[0] < 1e-6 and errors[1] < 1e-10
    assert errors[0] / errors[1] > 1.5 ** (method.accuracy - 2), errors


def _push(t, state):
    return jnp.array([3.0 * jnp.sin(20 * t), 2.0 * state.direction[0]])


@pytest.mark.parametrize(
    "given",
    [
        pytest.param({"motion": jaxrod.Spherical(), "azimuth_rate": 4.0}, marks=pytest.mark.slow),
        pytest.param({"motion": jaxrod.Flight(), "rate": 3.0}, marks=pytest.mark.slow),
        pytest.param({"motion": jaxrod.Rotation(0.3)}, marks=pytest.mark.slow),
        pytest.param({"forces": [jaxrod.TipForce(_push)]}, marks=pytest.mark.slow),
        {"gravity": None},
    ],
    ids=["spherical", "flight", "pivot", "loaded", "weightless"],
)
def test_every_flat_scene(given):
    """At times that are equally spaced and at others, as the default has it."""
    system, start = _thrown(**given)
    for ts in (jnp.linspace(0.0, 0.4, 5), jnp.array([0.1, 0.13, 0.4])):
        best = jaxrod.simulate(system, start, ts=ts, tolerance=1e-11)
        sol = jaxrod.simulate(system, start, ts=ts, solver=QuinlanTremaine12(), n_steps=700)
        np.testing.assert_allclose(sol.tip, best.tip, atol=2e-9)
        np.testing.assert_allclose(sol.rate, best.rate, atol=2e-7)
        np.testing.assert_allclose(sol.strain_rate, best.strain_rate, atol=2e-7)


def test_many_turns_and_energy():
    """Turns are counted, and the energy has no trend over 250 axial periods."""
    system, start = _thrown()
    ts = jnp.linspace(0.0, 10.0, 101)
    sol = jaxrod.simulate(system, start, ts=ts, solver=QuinlanTremaine10(), n_steps=8000)
    np.testing.assert_allclose(sol.angle[-1], jaxrod.simulate(system, start, t1=10.0).angle[-1], atol=1e-7)
    off = sol.energy / sol.energy[0] - 1
    assert np.max(np.abs(off)) < 1e-9 and abs(np.mean(off[51:]) - np.mean(off[1:51])) < 1e-10


def test_beside_a_collapse():
    """A scene that collapses has a code and no numbers, and changes no bit of its neighbours."""
    system, _ = _thrown()

    def run(strain_rate):
        start = system.state(rate=0.1, strain_rate=strain_rate)
        sol = jaxrod.simulate(system, start, t1=0.2, solver=QuinlanTremaine10(), n_steps=400, throw=False)
        return sol.tip[-1], sol.result

    rates = jnp.array([0.0, -400.0, 1.0])
    with pytest.warns(UserWarning, match="1 scenes did not end ok"):
        tips, results = jaxrod.sweep(run, rates)
    assert list(np.asarray(results == jaxrod.Result.ok)) == [True, False, True] and np.all(np.isnan(tips[1]))
    alone = jaxrod.sweep(run, rates[::2])[0]
    np.testing.assert_array_equal(tips[::2], alone)


@pytest.mark.slow
def test_derivatives():
    """Forwards and backwards, as those of the default: what cannot be undone is run again by what can."""
    system, _ = _thrown()

    def tip(rate, **how):
        return _tip(system, system.state(rate=rate), 0.2, **how)

    how = {"solver": QuinlanTremaine12(), "n_steps": 400}
    forward = jax.jvp(lambda rate: tip(rate, adjoint=diffrax.ForwardMode(), **how), (15.0,), (1.0,))[1]
    right = jax.jacrev(lambda rate: tip(rate, tolerance=1e-11))(15.0)
    np.testing.assert_allclose(forward, right, atol=1e-9)
    np.testing.assert_allclose(jax.jacrev(lambda rate: tip(rate, **how))(15.0), right, atol=1e-9)
    rates = jnp.array([15.0, 16.0])
    np.testing.assert_allclose(jax.vmap(jax.grad(lambda rate: tip(rate, **how)[0]))(rates)[0], right[0], atol=1e-9)


def test_lanes_of_different_counts():
    """Each scene takes its own steps, whatever its neighbours take; and from save times of its own."""
    system, start = _thrown()

    def end(**how):
        return jaxrod.simulate(system, start, solver=QuinlanTremaine10(), **how).angle

    counts = jnp.array([600, 605, 900])
    together = jax.vmap(lambda n: end(t1=1.0, n_steps=n))(counts)
    np.testing.assert_allclose(together, [end(t1=1.0, n_steps=int(n)) for n in counts], rtol=1e-12)
    first = jnp.array([0.05, 0.08])
    together = jax.vmap(lambda t: end(ts=jnp.stack([t, jnp.asarray(0.2)]), n_steps=200))(first)
    np.testing.assert_allclose(together, [end(ts=jnp.array([t, 0.2]), n_steps=200) for t in first], rtol=1e-12)


def test_refusals():
    system, start = _thrown()
    method = QuinlanTremaine10()
    with pytest.raises(ValueError, match="give n_steps="):
        _tip(system, start, solver=method)
    with pytest.raises(ValueError, match="equal steps alone"):
        _tip(system, start, solver=method, n_steps=100, chart=jaxrod.Angles())
    with pytest.raises(jaxrod.SimulationError, match="longest step that can be stable"):
        _tip(system, start, solver=method, n_steps=100)
    three = scene(basis=jaxrod.Ritz(3))
    driven = scene(jaxrod.Driven(lambda t: 3 * t))
    rubbed, begin = _thrown(forces=[jaxrod.PivotFriction(0.1)])
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (system, start))
    for other, state in ((three, three.state()), (driven, driven.state()), (rubbed, begin), single):
        with pytest.raises(ValueError, match="for uniform strain"):
            _tip(other, state, solver=method, n_steps=1000)
