"""The cheapest way that is good enough: it is, and nothing that is not is promised."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.accuracy import cost_model
from jaxrod.accuracy.fewest_steps import fewest
from jaxrod.accuracy.planning import _Search


def _steel(young=2e11):
    rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.01), young=young, density=7800.0)
    system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    return system, system.state(angle=0.3)


@pytest.fixture(scope="module")
def rigid_plan():
    return jaxrod.plan(*_steel(), t1=1.0, tolerance=1e-3)


def test_a_steel_link_is_rigid(rigid_plan):
    """2 delta omega T = 4e-6: a rigid rod, and its error is what it is said to be."""
    system, start = _steel()
    best = jaxrod.simulate(*jaxrod.ladder.on_rung(system, start, jaxrod.LoadRitz(4)), t1=1.0, tolerance=1e-11)
    sol = jaxrod.simulate(system, start, t1=1.0, plan=rigid_plan)
    assert rigid_plan.met and rigid_plan.basis.n == 0 and "rigid" in str(rigid_plan)
    assert float(sol.stats["num_steps"]) == rigid_plan.n_steps and sol.angle.dtype == rigid_plan.dtype
    error = float(jnp.max(jnp.abs(sol.tip[-1] - best.tip[-1])))
    assert error <= rigid_plan.error <= 1e-3


def test_followed_in_other_scenes_and_in_sweeps(rigid_plan):
    """Twice the time, twice the steps; the scene's own numbers, also where they are traced."""
    system, start = _steel()
    longer = jaxrod.simulate(system, start, t1=2.0, plan=rigid_plan)
    assert abs(float(longer.stats["num_steps"]) - 2 * rigid_plan.n_steps) <= 1
    angles = jnp.linspace(0.1, 0.4, 5)
    ends = jaxrod.sweep(
        lambda angle: jaxrod.simulate(system, system.state(angle=angle), t1=1.0, plan=rigid_plan).angle[-1], angles
    )
    one = jaxrod.simulate(system, system.state(angle=angles[2]), t1=1.0, plan=rigid_plan)
    np.testing.assert_allclose(ends[2], one.angle[-1], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-4])
def test_rubber_cone(cone, tolerance):
    """The angle after two seconds from a sudden start, which uniform strain misses by 0.23 rad."""
    exact = 28.9782615555
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    start = system.state(rate=15.0)
    found = jaxrod.plan(system, start, t1=2.0, tolerance=tolerance, quantity=jaxrod.FinalAngle())
    sol = jaxrod.simulate(system, start, t1=2.0, plan=found)
    assert found.met and 2 <= found.basis.n <= 4
    assert abs(float(sol.angle[-1]) - exact) <= found.error <= tolerance


@pytest.mark.slow
def test_kinks_cannot_be_met(uniform):
    """Let go from uniform strain, the tip follows a triangle wave, which no few shapes have, nor modes of the exact rod."""
    system = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1))
    start = system.state(strain=0.02)
    found = jaxrod.plan(system, start, t1=0.03, tolerance=1e-7)
    assert not found.met and "cannot be met, because the answer of the exact rod is known to" in str(found)
    rough = jaxrod.plan(system, start, t1=0.03, tolerance=1e-6)
    assert not rough.met and "from the exact rod, and 24 shapes would not mend it" in str(rough)
    with pytest.raises(ValueError, match="cannot be met"):
        jaxrod.simulate(system, start, t1=0.03, plan=found)


def test_refusals(rigid_plan):
    system, start = _steel()
    with pytest.raises(ValueError, match="tolerance="):
        jaxrod.plan(system, start, t1=1.0, tolerance=-1.0)
    with pytest.raises(ValueError, match=r"leave out solver"):
        jaxrod.simulate(system, start, t1=1.0, plan=rigid_plan, solver=jaxrod.ABA864())
    with pytest.raises(ValueError, match=r"plan=0\.001 is no plan; give"):
        jaxrod.simulate(system, start, t1=1.0, plan=1e-3)
    with pytest.warns(FutureWarning, match=r"simulate\(tolerance=plan\) is written simulate\(plan=plan\) now"):
        old = jaxrod.simulate(system, start, t1=1.0, tolerance=rigid_plan)
    assert old.tip[0, 0] == jaxrod.simulate(system, start, t1=1.0, plan=rigid_plan).tip[0, 0]
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda a: jaxrod.plan(system, system.state(angle=a), t1=1.0, tolerance=1e-3).error)(0.1)


@pytest.mark.slow
def test_laws_of_strain_and_late_starts(cone):
    """A neo-Hookean rod has no condensed rung; a rotor that has sped up for two seconds starts with the strain it has then."""
    rod = dataclasses.replace(cone, law=jaxrod.law.neo_hookean)
    system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    start, quantity = system.state(rate=8.0), jaxrod.LargestStrain()
    found = jaxrod.plan(system, start, t1=0.1, tolerance=1e-2, quantity=quantity)
    ts = quantity.times(0.0, 0.1)
    true = quantity(jaxrod.continuum.simulate(system, start, ts=ts))
    assert found.met and abs(quantity(jaxrod.simulate(system, start, ts=ts, plan=found)) - true) <= found.error <= 1e-3
    faster = jaxrod.System(cone, jaxrod.Driven(lambda t: 5.0 * t**2))
    when = {"t0": 2.0, "t1": 2.1}
    steady = jaxrod.plan(faster, faster.state(), **when, tolerance=1e-2, static=True)
    true = jaxrod.continuum.simulate(faster, faster.state(), t0=2.0, ts=[2.1], static=True).tip
    planned = jaxrod.simulate(faster, faster.state(), **when, plan=steady).tip
    assert steady.met and np.max(np.abs(planned - true)) <= steady.error <= 1e-2
    with pytest.raises(ValueError, match="static=True is of Hooke's law"):
        jaxrod.plan(system, start, t1=0.1, tolerance=1e-3, static=True)


def test_costs_grow():
    """With shapes, also beyond those that were measured, and with the float type."""
    for way in ("axial", "prescribed", "adaptive"):
        ns = [cost_model.stage(way, np.float64, n) for n in (3, 6, 9, 18)]
        assert np.all(np.diff(ns) > 0) and cost_model.stage(way, np.float32, 6) < ns[1]


@pytest.mark.slow
def test_no_promise_beyond_the_horizon():
    """A spring pendulum in 1 : 2 resonance: runs with finer and finer steps differ by 1e-4 after 70 s."""
    area = np.pi * 0.025**2
    spring = jaxrod.Lumped(inertia=400 * area, first_moment=600 * area, stiffness=17658 * area, length=1.0)
    system = jaxrod.System(spring, jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81)
    start = system.state(angle=-1.5708, strain=0.3333, rate=2.7, strain_rate=-4.8)
    near = jaxrod.plan(system, start, t1=30.0, tolerance=1e-6)
    true = jaxrod.simulate(system, start, t1=30.0, tolerance=1e-12).tip[-1]
    planned = jaxrod.simulate(system, start, t1=30.0, plan=near).tip[-1]
    assert near.met and jnp.max(jnp.abs(planned - true)) <= 1e-6
    for t1, tolerance in ((70.0, 1e-4), (74.0, 1e-3)):
        far = jaxrod.plan(system, start, t1=t1, tolerance=tolerance)
        assert not far.met and "beyond its horizon" in str(far)


def test_strains_that_jump_converge_slowly(uniform):
    """Let go from a stretch, or struck: errors fall as 1 / shapes; after a sudden spin as their square."""
    system = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1))
    struck = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1), forces=[jaxrod.TipForce(1.0)])
    rubbed = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1), forces=[jaxrod.PivotFriction(1.0)])
    tip = jaxrod.FinalTip()

    def power(scene, **start):
        return _Search(scene, scene.state(**start), tip, 0.0, tip.times(0.0, 1.0), False, 1e-3).power

    assert [power(system, rate=1.0), power(rubbed, rate=1.0)] == [2, 2]
    assert [power(system, strain=0.01), power(struck)] == [1, 1]


def test_one_bad_rung_is_no_refusal(uniform):
    """Let go, a rod of 12 shapes was worse than one of 9, and 24 brought its tip to 1e-6 m: what rungs were off by."""
    system = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1))
    tip = jaxrod.FinalTip()
    search = _Search(system, system.state(strain=0.01), tip, 0.0, tip.times(0.0, 1.0), False, 1e-6)
    rung = search.rung(jaxrod.LoadRitz(4))

    def off(error, n):
        return error, rung._replace(basis=jaxrod.LoadRitz(n))

    assert not search.hopeless([off(7.5e-5, 4), off(1.8e-6, 9), off(1.7e-5, 12)])
    assert search.hopeless([off(1.7e-5, 12)]) and not search.hopeless([off(1.0, 3)])


@pytest.mark.parametrize("order", [2, 6, 10])
def test_the_fewest_steps_by_the_order(order):
    """Of an error that falls as a power, from too many and from too few; none where it falls no further."""

    def off(steps):
        return steps**-order + 1e-9 if steps > 3 else np.inf

    few = 1e-6 ** (-1 / order)
    for begin in (1.0, 100.0):
        found = fewest(off, 1.0, begin, order, 1e-6)
        assert found is not None and few <= found <= 2 * few
    assert fewest(off, 5 * few, 1.0, order, 1e-6) == 5 * few
    assert fewest(off, 1.0, 1.0, order, 1e-10) is None


def test_an_error_that_is_zero_by_luck():
    """Between two signs of it: steps beside tell."""
    lucky = [30.0]

    def off(steps):
        return 0.0 if steps in lucky else 1e4 * steps**-4.0

    found = fewest(off, 1.0, 30.0, 4, 1e-3)
    assert found is not None and found > 50


def test_as_many_steps_as_planned(rigid_plan):
    """Also where the end is rounded to float32, up or down."""
    system, start = _steel()
    for steps in (181, 1999, 12345):
        for t1 in np.random.default_rng(steps).uniform(0.5, 2.0, 6).tolist():
            planned = dataclasses.replace(rigid_plan, dtype="float32", step=t1 / steps)
            taken = planned.steps(*planned.applied(system, start), 0.0, jnp.asarray(t1, jnp.float32))["n_steps"]
            assert int(taken) == steps


@pytest.mark.slow
def test_a_quantity_of_ones_own_may_look_at_another_rod(cone):
    """Which has another projection."""
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    seen = []

    def stiffer(sol):
        rod = dataclasses.replace(sol.system.rod, young=4 * sol.system.rod.young)
        both = [jaxrod.natural_frequencies(x)[:1] for x in (dataclasses.replace(sol.system, rod=rod), sol.system)]
        ratio = jnp.sum(both[0]) / jnp.sum(both[1]) if sol.system.basis.n else jnp.asarray(2.0)
        seen.append(ratio)
        return ratio + 0 * sol.angle[-1]

    jaxrod.plan(system, system.state(rate=8.0), t1=0.1, tolerance=1e-3, quantity=stiffer)
    np.testing.assert_allclose([float(x) for x in seen if not isinstance(x, jax.core.Tracer)], 2.0)
