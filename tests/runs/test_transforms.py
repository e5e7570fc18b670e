"""jit, vmap and grad around `simulate`, in any nesting, give what a plain Python loop gives."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod import Result

YOUNG = jnp.array([4e6, 1e7, 3e7])
RADIUS = jnp.array([0.02, 0.025, 0.03])
RATES = jnp.array([5.0, 15.0, 25.0])
ROD = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)


def outcome(young, radius, rate):
    """All that matters at the end of 0.2 s: angle, strain and the tip (4,).  (The tip radius makes it a cone.)"""
    section = jaxrod.Cone(radius, 0.03)
    rod = dataclasses.replace(ROD, young=young, section=section)
    system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81)
    sol = jaxrod.simulate(system, system.state(angle=0.3, rate=rate, strain=0.01), t1=0.2)
    return jnp.concatenate([sol.angle, sol.strain, sol.tip[0]])


def angle(young, radius, rate):
    return outcome(young, radius, rate)[0]


def _same(x, y, rtol=1e-12):
    """To a relative error of the largest of each quantity: sums are not always taken in the same order."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert np.isfinite(x).all()
    scale = np.abs(y).reshape(-1, y.shape[-1]).max(axis=0) if y.ndim else np.abs(y)
    np.testing.assert_array_less(np.abs(x - y), np.broadcast_to(rtol * scale, y.shape))


# ---- values


@functools.cache
def _loop():
    """The plain loop over rods (rows) and rates (columns)."""
    return np.array([[outcome(e, r, rate) for rate in RATES] for e, r in zip(YOUNG, RADIUS, strict=True)])


def test_the_loop_itself():
    """The scenes differ, so that equality below means something."""
    flat = _loop().reshape(9, 4)
    for i in range(9):
        for j in range(i):
            assert (np.abs(flat[i] - flat[j]) > 1e-6).all()


def test_jit():
    fn = jax.jit(outcome)
    _same([[fn(e, r, rate) for rate in RATES] for e, r in zip(YOUNG, RADIUS, strict=True)], _loop())


def test_vmap_over_starts():
    _same(jax.vmap(outcome, (None, None, 0))(YOUNG[1], RADIUS[1], RATES), _loop()[1])


def test_vmap_over_rods():
    _same(jax.vmap(outcome, (0, 0, None))(YOUNG, RADIUS, RATES[2]), _loop()[:, 2])


def test_vmap_of_jit_over_both():
    _same(jax.vmap(jax.jit(outcome))(YOUNG, RADIUS, RATES), _loop()[np.arange(3), np.arange(3)])


def test_jit_of_vmap_of_vmap():
    starts = jax.vmap(outcome, (None, None, 0))
    _same(jax.jit(jax.vmap(starts, (0, 0, None)))(YOUNG, RADIUS, RATES), _loop())


def test_solutions_pass_through_vmap():
    """Not numbers alone: a whole Solution comes out, scenes before times, and its properties work on it."""
    system = jaxrod.System(ROD, jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81)
    ts = jnp.linspace(0.0, 0.2, 3)

    def run(rate):
        return jaxrod.simulate(system, system.state(angle=0.3, rate=rate), ts=ts)

    many = jax.vmap(run)(RATES)
    assert many.angle.shape == many.energy.shape == (3, 3)
    assert many.tip.shape == (3, 3, 2)
    assert many.shape(jnp.linspace(0.0, 1.0, 5)).shape == (3, 3, 5, 2)
    assert many.ok.tolist() == [True] * 3
    assert str(many) == "Solution of 3 scenes by BlanesMoan6, UniformStrainSplitting"
    one = run(RATES[1])
    for name in ("angle", "strain", "tip", "energy"):
        np.testing.assert_allclose(getattr(many, name)[1], getattr(one, name), rtol=1e-12, atol=1e-12)


# ---- gradients

GRAD = jax.grad(angle, argnums=(0, 1, 2))


@functools.cache
def _gradients():
    """The plain loop: gradients of the end angle in young, radius and rate, one scene after the other (3, 3)."""
    return np.array([GRAD(e, r, rate) for e, r, rate in zip(YOUNG, RADIUS, RATES, strict=True)])


@pytest.mark.slow
def test_vmap_of_grad():
    _same(np.stack(jax.vmap(GRAD)(YOUNG, RADIUS, RATES), axis=1), _gradients(), rtol=1e-9)


def test_jit_of_grad_of_vmap():
    """Of a sum over scenes: each scene's gradient for what it has alone, the sum of all for what they share."""

    def total(stiffer, rates):
        return jax.vmap(lambda e, r, rate: angle(stiffer * e, r, rate))(YOUNG, RADIUS, rates).sum()

    shared, own = jax.jit(jax.grad(total, argnums=(0, 1)))(1.0, RATES)
    _same(own, _gradients()[:, 2], rtol=1e-9)
    _same(shared, YOUNG @ _gradients()[:, 0], rtol=1e-9)


# ---- bad values that nobody can see coming


def trouble(scene):
    """One scene, told by its code; a failing run takes no more than 2,000 steps."""
    young, radius, rate, strain = scene
    rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(radius), young=young, density=1200.0)
    system = jaxrod.System(rod, jaxrod.Rotation())
    sol = jaxrod.simulate(system, system.state(angle=0.3, strain=strain, strain_rate=rate), t1=0.05, max_steps=2_000)
    return {"angle": sol.angle[0], "strain": sol.strain[0], "result": sol.result}


SCENES = [  # young, radius, strain rate, strain; how it ends
    (1e7, 0.02, 5.0, 0.0, Result.ok),
    (-1e7, 0.02, 5.0, 0.0, Result.invalid),
    (2e7, 0.02, -5.0, 0.0, Result.ok),
    (1e7, 0.02, -500.0, 0.0, Result.collapsed),
    (1e7, 0.02, 9.0, 0.1, Result.ok),
    (math.nan, 0.02, 5.0, 0.0, Result.invalid),
    (1e7, 0.02, math.inf, 0.0, Result.invalid),
    (1e7, 0.02, 5.0, -1.5, Result.invalid),
    (1e7, 0.0, 5.0, 0.0, Result.invalid),
    (1e6, 0.02, 5.0, 0.0, Result.ok),
    (0.0, 0.02, 5.0, 0.0, Result.invalid),
]
INPUTS = tuple(jnp.array(column) for column in zip(*(scene[:4] for scene in SCENES), strict=True))
GOOD = np.array([i for i, scene in enumerate(SCENES) if scene[4] == Result.ok])


@functools.cache
def _mapped():
    return jax.jit(jax.vmap(trouble))(INPUTS)


def test_failing_lanes_are_told_and_alone():
    """Each lane has its own code, nothing is thrown, and the neighbours' answers are those of a batch without it."""
    together = _mapped()
    for i, scene in enumerate(SCENES):
        assert (together["result"] == scene[4])[i], i
        assert np.isnan(together["angle"][i]) == (scene[4] == Result.invalid), i
    alone = jax.jit(jax.vmap(trouble))(tuple(x[GOOD] for x in INPUTS))
    for name in ("angle", "strain"):
        np.testing.assert_allclose(together[name][GOOD], alone[name], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("block", [4, 64])
def test_sweep_is_vmap(block):
    """Eleven scenes, in two blocks and a rest of three, and all at once; the warning counts the lost."""
    with pytest.warns(UserWarning, match="sweep: 7 scenes did not end ok, 6 gave answers that are not finite"):
        swept = jaxrod.sweep(trouble, INPUTS, block=block)
    mapped = _mapped()
    assert (swept["result"] == mapped["result"]).all()
    for name in ("angle", "strain"):
        np.testing.assert_allclose(swept[name], mapped[name], rtol=1e-12, atol=1e-15)


def test_sweep_without_trouble_is_silent():
    """Warnings are errors here."""
    out = jaxrod.sweep(lambda x: {"double": 2 * x, "both": (x, x)}, jnp.arange(7.0), block=3)
    np.testing.assert_array_equal(out["double"], 2 * np.arange(7.0))
    np.testing.assert_array_equal(out["both"][1], np.arange(7.0))


def test_sweep_counts_answers_that_are_not_finite():
    with pytest.warns(UserWarning, match="sweep: 0 scenes did not end ok, 2 gave answers that are not finite"):
        jaxrod.sweep(lambda x: {"root": jnp.sqrt(x), "log": jnp.log(x)}, jnp.array([-1.0, 0.0, 1.0, 2.0]), block=3)


# ---- types


def test_dtype_is_followed():
    """What is given in float32 is computed in float32, though float64 is JAX's default here; no value is needed."""
    with pytest.warns(UserWarning, match="rod.young is in float32"):  # beside Python's numbers
        mapped = jax.eval_shape(jax.vmap(outcome, (0, None, None)), YOUNG.astype(jnp.float32), 0.02, 5.0)
    assert mapped.dtype == jnp.float32
    system = jaxrod.System(ROD, jaxrod.Spherical(), gravity=9.81)
    scene = jax.tree.map(lambda x: x.astype(jnp.float32), (system, system.state(rate=1.0)))
    sol = jax.eval_shape(lambda scene: jaxrod.simulate(*scene, ts=jnp.linspace(0.0, 1.0, 4)), scene)
    assert {leaf.dtype for leaf in jax.tree.leaves((sol.ts, sol.states, sol.system))} == {jnp.dtype("float32")}
