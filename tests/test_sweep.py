"""Sweeps: the same bits whatever block, order, devices and neighbours; what they refuse and say."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod
from jaxrod import Result

RATES = np.linspace(3.0, 16.0, 37)


def _by_rate(n=1):
    system = scene(basis=jaxrod.Ritz(n), gravity=9.81)

    def fn(rate):
        sol = jaxrod.simulate(system, system.state(rate=rate), t1=0.2)
        return {"tip": sol.tip[-1], "strain": sol.strain[-1], "result": sol.result}

    return fn


def _same(a, b, which=slice(None)):
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(np.asarray(x)[which], np.asarray(y)[which])


@pytest.mark.parametrize("n", [1, 2])
def test_bit_equal(n):
    """Blocks of 1 to 256, a shuffled order, one device and all."""
    fn = _by_rate(n)
    first = jaxrod.sweep(fn, RATES)
    for options in ({"block": 1}, {"block": 17}, {"block": 256}, {"devices": 1}, {"devices": 1, "block": 8}):
        _same(jaxrod.sweep(fn, RATES, **options), first)
    _same(jaxrod.sweep(fn, RATES, order_by=lambda rate: -rate), first)
    shuffled = np.random.default_rng(0).permutation(RATES.size)
    again = jaxrod.sweep(fn, RATES[shuffled], block=16)
    _same(again, jax.tree.map(lambda x: x[shuffled], first))


def test_bit_equal_beside_a_lane_that_collapses():
    system = scene(gravity=9.81)

    def fn(rate, strain_rate):
        start = system.state(rate=rate, strain_rate=strain_rate)
        sol = jaxrod.simulate(system, start, ts=jnp.array([0.1, 0.2]))
        return {"tip": sol.tip, "result": sol.result}

    calm = np.zeros_like(RATES)
    wild = calm.copy()
    wild[5], wild[20] = -2000.0, np.nan
    alone = jaxrod.sweep(lambda x: fn(*x), (RATES, calm))
    with pytest.warns(UserWarning, match="2 scenes did not end ok"):
        beside = jaxrod.sweep(lambda x: fn(*x), (RATES, wild))
    good = np.setdiff1d(np.arange(RATES.size), [5, 20])
    _same(beside, alone, good)
    assert (beside["result"] == Result.invalid)[20] and not (beside["result"] == Result.ok)[5]


def test_whole_solutions_of_a_sweep_draw_no_warning():
    """A method whose steps may be as long as one likes says so by a number."""
    system = scene(gravity=9.81)
    runs = jaxrod.sweep(lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=0.1), RATES[:3])
    assert runs.ok.all() and np.isfinite(runs.stats["longest_step"]).all()


def test_gradients_in_a_sweep():
    """Forward and reverse derivatives of each scene, as of one scene alone."""
    fn = _by_rate()

    def strain(rate):
        return fn(rate)["strain"]

    def forwards(rate):
        end = jaxrod.simulate(system, system.state(rate=rate), t1=0.2, adjoint=diffrax.ForwardMode())
        return end.strain[-1]

    system = scene(gravity=9.81)
    swept = jaxrod.sweep(jax.value_and_grad(strain), RATES[:9])
    alone = [jax.grad(strain)(rate) for rate in RATES[:2]]
    np.testing.assert_allclose(swept[1][:2], alone, rtol=1e-11)
    along = jaxrod.sweep(jax.jacfwd(forwards), RATES[:9])
    np.testing.assert_allclose(along, swept[1], rtol=1e-8)
    _same(jaxrod.sweep(jax.value_and_grad(strain), RATES[:9], block=2), swept)


@pytest.mark.parametrize("motion", [jaxrod.Spherical(), jaxrod.Driven(lambda t: 8 * t)], ids=["in space", "driven"])
def test_bit_equal_with_rods_of_their_own(cone, motion):
    def fn(young):
        system = scene(motion, gravity=9.81, rod=cone, young=young)
        driven = isinstance(motion, jaxrod.Driven)
        start = system.state() if driven else system.state(rate=6.0, azimuth_rate=2.0)
        return jaxrod.simulate(system, start, t1=0.1).tip[-1]

    young = np.geomspace(5e6, 5e7, 21)
    first = jaxrod.sweep(fn, young)
    for options in ({"block": 1}, {"block": 9, "devices": 1}, {"order_by": -young}):
        _same(jaxrod.sweep(fn, young, **options), first)


def test_answers_of_no_numbers_and_of_many_results():
    out = jaxrod.sweep(lambda x: (jnp.zeros((0,)), x), jnp.arange(5.0))
    assert out[0].shape == (5, 0)
    system = scene(gravity=9.81)

    def twice(rate):
        sol = jaxrod.simulate(system, system.state(rate=rate), t1=0.1)
        return sol.result, sol.result

    with pytest.warns(UserWarning, match="sweep: 1 scenes did not end ok"):
        jaxrod.sweep(twice, np.array([1.0, np.nan, 2.0]))


def test_under_a_transformation_it_is_a_map():
    np.testing.assert_array_equal(
        jax.jit(lambda x: jaxrod.sweep(jnp.square, x, block=3))(jnp.arange(5.0)), np.arange(5.0) ** 2
    )


def test_many_calls_and_a_rest():
    """More scenes than one call holds, a last call that is not full; answers of several types."""
    x = np.arange(5000)
    out = jaxrod.sweep(lambda x: (x % 7, jnp.stack([x, 2 * x]) * 0.5), x, block=8)
    np.testing.assert_array_equal(out[0], x % 7)
    np.testing.assert_array_equal(out[1], np.stack([x, 2 * x], axis=1) * 0.5)


def test_random_keys():
    keys = jax.random.split(jax.random.key(0), 12)
    swept = jaxrod.sweep(lambda key: jax.random.uniform(key), keys)
    np.testing.assert_array_equal(swept, jax.vmap(jax.random.uniform)(keys))


def test_progress(capsys):
    jaxrod.sweep(jnp.square, jnp.arange(100.0), progress=True)
    assert "100" not in capsys.readouterr().out  # on the error stream, and only after two seconds


def test_refusals():
    x = jnp.arange(4.0)
    with pytest.raises(ValueError, match="block=0 must be a positive whole number"):
        jaxrod.sweep(jnp.square, x, block=0)
    with pytest.raises(ValueError, match=r"devices=99 are not there, JAX has \d+; call jaxrod.configure"):
        jaxrod.sweep(jnp.square, x, devices=99)
    with pytest.raises(ValueError, match=r"block=2\.0 must be a positive whole number"):
        jaxrod.sweep(jnp.square, x, block=2.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="devices=0 must be a positive whole number"):
        jaxrod.sweep(jnp.square, x, devices=0)
    with pytest.raises(ValueError, match="one predicted cost a scene, finite"):
        jaxrod.sweep(jnp.square, x, order_by=lambda x: jnp.log(x - 1))
    with pytest.raises(ValueError, match=r"order_by gives numbers of shape \(2,\) for 4 scenes"):
        jaxrod.sweep(jnp.square, x, order_by=[1.0, 2.0])
    with pytest.raises(ValueError, match=r"inputs have shapes \{'\[0\]': \(4,\), '\[1\]': \(3,\)\}"):
        jaxrod.sweep(lambda x: x[0], (x, jnp.arange(3.0)))
