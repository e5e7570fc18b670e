"""The error that a run states is the error that it has."""

import dataclasses
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import make_rod, scene

import jaxrod
from jaxrod.accuracy.error_budget import nudged
from jaxrod.accuracy.ladder import on_rung
from jaxrod.continuum import closed_forms

# The exact rod of the paper's Figure 2 from a sudden start (unstretched): 80 exact modes and Richardson's limit of finite
# elements agree in these digits.
ANGLE = 28.9782615555


def _sudden(n):
    system = scene(basis=jaxrod.Ritz(n), gravity=9.81)
    return system, system.state(rate=15.0)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 3])
def test_angle_of_the_exact_rod(n):
    system, start = _sudden(n)
    budget = jaxrod.simulate(system, start, t1=2.0, budget=jaxrod.FinalAngle()).budget
    off = abs(float(budget.value) - ANGLE)
    assert bool(budget.bounded) and off < float(budget.bound) < 3 * off
    assert float(budget.model) > 1e3 * float(budget.step + budget.rounding)
    assert "rad ±" in str(budget) and "bending" in str(budget)


def test_first_frequency_against_the_exact_one():
    system, start = _sudden(1)
    budget = jaxrod.simulate(system, start, t1=0.01, budget=jaxrod.FirstFrequency()).budget
    exact = 120.88186175927 / (2 * np.pi)
    np.testing.assert_allclose(budget.model, abs(float(budget.value) - exact), rtol=1e-9)


@pytest.mark.slow
def test_first_frequency_of_cones_in_closed_form():
    """The bound is the error, to the rounding that it allows for: on the rung that is nearest too."""
    for motion, form in ((jaxrod.Rotation(), closed_forms.held_free), (jaxrod.Flight(), closed_forms.free_free)):
        for tip in (0.01, 0.03, 0.06):
            rod = make_rod(section=jaxrod.Cone(0.02, tip))
            system = scene(motion, jaxrod.LoadRitz(3), rod=rod)
            budget = jaxrod.simulate(system, system.state(), t1=1e-3, budget=jaxrod.FirstFrequency()).budget
            off = abs(budget.value - form(jnp.asarray(0.02), jnp.asarray(tip), 1)[0] * rod.wave_speed / (2 * np.pi))
            assert off <= budget.bound <= max(10 * off, 1e-12)


@pytest.mark.slow
def test_more_shapes_that_agree_by_chance_are_not_the_truth():
    """What is left beyond the shapes that were tried is never taken for nothing: errors may fall as slowly as 1 / n."""
    system, start = _sudden(3)
    budget = jaxrod.simulate(system, start, t1=0.5, budget=jaxrod.FinalTip()).budget
    most = jaxrod.simulate(*on_rung(system, start, jaxrod.LoadRitz(9)), t1=0.5, tolerance=1e-10)
    changed = jnp.abs(budget.value - most.tip[-1])
    assert jnp.all(budget.model >= 1.499 * changed)  # 3 of 9 shapes: half of it may still come
    assert jnp.all(budget.bound <= 10 * changed)


@pytest.mark.slow
def test_driven_near_the_critical_rate_against_the_exact_rod():
    """A kink in the strain, amplified: the exact rod is inside the bound, and the bound within ten times the error."""
    rate = 0.9 * jaxrod.continuum.critical_rate(scene())
    system = scene(jaxrod.scenes.steady(rate), jaxrod.Ritz(2), gravity=9.81)
    budget = jaxrod.simulate(system, system.state(), t1=0.3, budget=jaxrod.FinalTip()).budget
    true = jaxrod.continuum.simulate(system, system.state(), ts=jnp.array([0.3]), modes=32, error=False)
    off = jnp.abs(budget.value - true.tip[-1])
    assert jnp.all((off <= budget.bound) & (budget.bound <= 10 * off))


def test_a_finer_run_that_fails_is_no_lost_phase():
    system = jaxrod.paper.literal()
    budget = jaxrod.simulate(system, system.state(rate=15.0), t1=0.2, budget=jaxrod.FinalAngle()).budget
    failed, lost = (dataclasses.replace(budget, step=jnp.asarray(step)) for step in (jnp.inf, 1.0))
    assert "no bound: this run or a finer one did not reach its end" in str(failed) and not bool(failed.bounded)
    assert "no bound: the phase is lost" in str(lost) and np.isinf(lost.bound)


def test_steps_that_are_too_long_are_seen():
    """With few steps the error of the steps is the largest part, and is what it is said to be."""
    system, start = _sudden(3)
    coarse = jaxrod.simulate(system, start, t1=0.5, n_steps=25, solver=jaxrod.ABA864(), budget=jaxrod.FinalTip())
    fine = jaxrod.simulate(system, start, t1=0.5, tolerance=1e-12)
    np.testing.assert_allclose(coarse.budget.step, jnp.abs(coarse.tip[-1] - fine.tip[-1]), rtol=1e-6)
    assert jnp.max(coarse.budget.step) > 1e-7


def test_a_lost_phase_has_no_bound():
    """Ten seconds after a sudden start uniform strain is more than a radian behind the rod."""
    system, start = _sudden(1)
    budget = jaxrod.simulate(system, start, t1=10.0, budget=jaxrod.FinalAngle()).budget
    assert not bool(budget.bounded) and np.isinf(budget.bound)
    assert "no bound" in str(budget)


@pytest.mark.parametrize("quantity", [jaxrod.FinalAngle(), jaxrod.LargestStrain()], ids=lambda x: x.name)
def test_beyond_the_horizon_there_is_no_bound(quantity):
    """A spring pendulum in 1 : 2 resonance: starts 1e-12 apart part for good after 90 s, where runs agree by chance."""
    area = np.pi * 0.025**2
    spring = jaxrod.Lumped(inertia=400 * area, first_moment=600 * area, stiffness=17658 * area, length=1.0)
    system = scene(rod=spring, gravity=9.81)
    start = system.state(angle=-1.5708, strain=0.3333, rate=2.7, strain_rate=-4.8)

    def run(t1, **steps):
        return jaxrod.simulate(system, start, ts=jnp.linspace(0.0, t1, 201)[1:], **steps)

    within = run(40.0, budget=quantity).budget
    assert abs(within.value - quantity(run(40.0, tolerance=1e-12))) <= within.bound < 1e-5
    for t1 in (110.0, 150.0, 200.0):
        budget = run(t1, budget=quantity).budget
        assert np.isinf(budget.bound) and "beyond its horizon" in str(budget)


@pytest.mark.parametrize("angle", np.arange(8) * np.pi / 4)
@pytest.mark.parametrize("motion", [jaxrod.Rotation(), jaxrod.Spherical()], ids=repr)
def test_a_start_beside_is_turned(motion, angle):
    """From whatever direction, and in space within the plane of a swing as out of it."""
    system = scene(motion)
    start = system.state(angle=angle)
    upwards = [-np.sin(angle), np.cos(angle)]
    ways = [upwards] if motion.dimension == 2 else [[0.0, 1.0, 0.0], [upwards[0], 0.0, upwards[1]]]
    moved = np.asarray(nudged(start, 1e-6).direction - start.direction)
    for way in ways:
        assert abs(abs(moved @ np.asarray(way)) - 1e-6) < 1e-9


def test_own_quantities_and_lumped_bodies():
    """A function of the solution; of a body without shapes there is no error of the model."""
    system = jaxrod.paper.literal()
    budget = jaxrod.simulate(system, system.state(rate=15.0), t1=0.2, budget=lambda sol: sol.energy[-1]).budget
    assert float(budget.model) == 0 and 0 < float(budget.bound) < 1e-8
    with pytest.raises(ValueError, match="Lumped"):
        on_rung(system, system.state(), jaxrod.Ritz(3))


@pytest.mark.slow
def test_budgets_under_vmap():
    """Of many scenes at once, as of one."""
    system, _ = _sudden(2)

    def parts(rate):
        budget = jaxrod.simulate(system, system.state(rate=rate), t1=0.2, budget=jaxrod.FinalAngle()).budget
        return budget.value, budget.model, budget.bound

    rates = jnp.array([10.0, 15.0])
    many, one = jax.vmap(parts)(rates), parts(rates[1])
    for a, b in zip(many, one, strict=True):
        np.testing.assert_allclose(a[1], b, rtol=1e-3)


@pytest.mark.parametrize("pivot", [0.0, 0.3])
def test_a_richer_rung_keeps_the_strain(pivot):
    """Uniform strain is uniform in every basis that has it, and the nearest field elsewhere."""
    system = scene(jaxrod.Rotation(pivot))
    start = system.state(rate=3.0, strain=0.02, strain_rate=0.5)
    for basis, tolerance in ((jaxrod.Ritz(4), 1e-12), (jaxrod.LoadRitz(6), 0.1)):  # whose tips are free of stress
        raised, state = on_rung(system, start, basis)
        np.testing.assert_allclose(raised.tip(state), system.tip(start), atol=0.02 * tolerance)
        np.testing.assert_allclose(raised.energy(state), system.energy(start), rtol=tolerance)
    lowered, back = on_rung(*on_rung(system, start, jaxrod.Ritz(4)), jaxrod.Ritz(1))
    np.testing.assert_allclose(back.amplitudes, start.amplitudes, rtol=1e-12)
    assert lowered == dataclasses.replace(system, basis=lowered.basis)


@pytest.mark.slow
def test_several_quantities_share_their_runs(monkeypatch):
    """Each has the budget that it has alone; the finer runs are made once, and not for what is known without them."""
    made, real = [], sys.modules["jaxrod.accuracy.error_budget"].finer_runs
    monkeypatch.setattr(
        sys.modules["jaxrod.accuracy.error_budget"], "finer_runs", lambda *given: [made.append(given), real(*given)][1]
    )
    system, start = _sudden(1)

    def budget(asked):
        return jaxrod.simulate(system, start, t1=0.1, budget=asked).budget

    budget(jaxrod.FirstFrequency())
    assert not made
    angle, tip, _ = budget([jaxrod.FinalAngle(), jaxrod.FinalTip(), jaxrod.FirstFrequency()])
    assert len(made) == 1
    np.testing.assert_array_equal(angle.bound, budget(jaxrod.FinalAngle()).bound)
    np.testing.assert_array_equal(tip.bound, budget(jaxrod.FinalTip()).bound)


@pytest.mark.slow
def test_the_largest_of_a_run_is_looked_for():
    """Given its end alone, a run is looked at where the quantity wants it; and several may be asked for at once."""
    system, start = _sudden(3)
    asked = [jaxrod.LargestStrain(), jaxrod.FinalTip()]
    largest, tip = jaxrod.simulate(system, start, t1=0.1, budget=asked).budget
    sol = jaxrod.simulate(system, start, ts=asked[0].times(0.0, 0.1), budget=asked[0])
    np.testing.assert_allclose(largest.value, sol.budget.value, rtol=1e-9)
    assert largest.value > 1.05 * jnp.abs(sol.strain[-1]) and tip.value.shape == (2,)
    assert "how stiffness changes with strain" in str(tip) and largest.strain > sol.strain.max()


@pytest.mark.parametrize("quantity", ["tip", True, jaxrod.FinalTip, 3.0], ids=str)
def test_no_quantity(quantity):
    """Said before anything runs."""
    system, start = _sudden(1)
    calls = [
        lambda: jaxrod.simulate(system, start, t1=0.1, budget=quantity),
        lambda: jaxrod.plan(system, start, t1=0.1, tolerance=1e-2, quantity=quantity),
        lambda: jaxrod.tradeoff(system, start, t1=0.1, quantity=quantity),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"quantity .* cannot be asked for; give one, such as FinalTip\(\)"):
            call()


def test_whole_numbers_are_a_quantity():
    system, start = _sudden(1)
    budget = jaxrod.simulate(system, start, t1=0.1, budget=lambda sol: jnp.argmax(sol.angle)).budget
    assert budget.value == 0.0 and budget.bound < 1e-9


@pytest.mark.slow
def test_a_tip_force_is_held_by_the_richer_rungs():
    """Shapes that loads make have no tension at a free tip: against them a steady pull would have too wide a bound."""
    system = scene(basis=jaxrod.ForceRitz(3), forces=[jaxrod.TipForce(50.0)])
    start = jaxrod.ladder.at_rest(system, system.state())
    budget = jaxrod.simulate(system, start, t1=0.05, budget=jaxrod.FinalTip()).budget
    assert jnp.max(budget.model) < 1e-9


@pytest.mark.slow
def test_a_run_that_stops_has_no_bound():
    """Whatever it was worth where it stopped; and where richer rungs stop, which are pressed through themselves."""
    system, start = _sudden(1)
    cut = jaxrod.simulate(system, start, t1=1.0, max_steps=3, throw=False, budget=jaxrod.FinalAngle()).budget
    assert np.isfinite(cut.value) and np.isinf(cut.bound) and "did not reach its end" in str(cut)
    fast = scene()
    spun = fast.state(rate=3 * jaxrod.continuum.critical_rate(fast))
    budget = jaxrod.simulate(fast, spun, t1=0.87, budget=lambda sol: sol.energy[-1]).budget
    assert np.isinf(budget.bound) and np.isfinite(budget.step) and "did not reach its end" in str(budget)


@pytest.mark.slow
@pytest.mark.parametrize("at", [-0.1, 1.1, np.nan])
def test_a_section_that_is_not_there(at):
    system, start = _sudden(1)
    with pytest.raises(ValueError, match="at="):
        jaxrod.simulate(system, start, t1=0.01, budget=jaxrod.LargestStrain(at=at))
