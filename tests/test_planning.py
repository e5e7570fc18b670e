"""The cheapest way that is good enough: it is, and nothing that is not is promised."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod import cost


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
    sol = jaxrod.simulate(system, start, t1=1.0, tolerance=rigid_plan)
    assert rigid_plan.met and rigid_plan.basis.n == 0 and "rigid" in str(rigid_plan)
    assert float(sol.stats["num_steps"]) == rigid_plan.n_steps and sol.angle.dtype == rigid_plan.dtype
    error = float(jnp.max(jnp.abs(sol.tip[-1] - best.tip[-1])))
    assert error <= rigid_plan.error <= 1e-3


def test_followed_in_other_scenes_and_in_sweeps(rigid_plan):
    """Twice the time, twice the steps; the scene's own numbers, also where they are traced."""
    system, start = _steel()
    longer = jaxrod.simulate(system, start, t1=2.0, tolerance=rigid_plan)
    assert abs(float(longer.stats["num_steps"]) - 2 * rigid_plan.n_steps) <= 1
    angles = jnp.linspace(0.1, 0.4, 5)
    ends = jaxrod.sweep(
        lambda angle: jaxrod.simulate(system, system.state(angle=angle), t1=1.0, tolerance=rigid_plan).angle[-1], angles
    )
    one = jaxrod.simulate(system, system.state(angle=angles[2]), t1=1.0, tolerance=rigid_plan)
    np.testing.assert_allclose(ends[2], one.angle[-1], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_rubber_cone(cone, tolerance):
    """The angle after two seconds from a sudden start, which uniform strain misses by 0.23 rad."""
    exact = 28.9782615555
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    start = system.state(rate=15.0)
    found = jaxrod.plan(system, start, t1=2.0, tolerance=tolerance, quantity=jaxrod.FinalAngle())
    sol = jaxrod.simulate(system, start, t1=2.0, tolerance=found)
    assert found.met and 2 <= found.basis.n <= 4
    assert abs(float(sol.angle[-1]) - exact) <= found.error <= tolerance


@pytest.mark.slow
def test_kinks_cannot_be_met(uniform):
    """Let go from uniform strain, the tip follows a triangle wave, which no few shapes have."""
    system = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1))
    start = system.state(strain=0.02)
    found = jaxrod.plan(system, start, t1=0.03, tolerance=1e-7)
    assert not found.met and "cannot be met, because LoadRitz(16)" in str(found)
    with pytest.raises(ValueError, match="cannot be met"):
        jaxrod.simulate(system, start, t1=0.03, tolerance=found)


def test_refusals(rigid_plan):
    system, start = _steel()
    with pytest.raises(ValueError, match="tolerance="):
        jaxrod.plan(system, start, t1=1.0, tolerance=-1.0)
    with pytest.raises(ValueError, match=r"leave out solver"):
        jaxrod.simulate(system, start, t1=1.0, tolerance=rigid_plan, solver=jaxrod.ABA864())
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda a: jaxrod.plan(system, system.state(angle=a), t1=1.0, tolerance=1e-3).error)(0.1)


def test_costs_grow():
    """With shapes, also beyond those that were measured, and with the float type."""
    for way in ("axial", "prescribed", "adaptive"):
        ns = [cost.stage(way, np.float64, n) for n in (3, 6, 9, 18)]
        assert np.all(np.diff(ns) > 0) and cost.stage(way, np.float32, 6) < ns[1]
