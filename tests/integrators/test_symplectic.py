"""Symplectic solvers: order, reversal, dense output, energy without a trend, derivatives by running backwards."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod import Result
from jaxrod.integrators.symplectic import AbstractSymplectic, SplitTerm, single_step

SOLVERS = [jaxrod.StormerVerlet(), jaxrod.BlanesMoan4(), jaxrod.BlanesMoan6(), jaxrod.ABA864()]
GENERAL = [solver for solver in SOLVERS if not solver.needs_nystrom]


def _name(x):
    return type(x).__name__ if isinstance(x, AbstractSymplectic) else str(x)


@pytest.mark.parametrize("solver", SOLVERS, ids=_name)
def test_coefficients(solver):
    """Palindromes that add up to one; halves of kicks and drifts belong together."""
    for numbers in (solver.drifts, solver.kicks):
        assert sum(numbers) == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose(numbers, numbers[::-1], atol=1e-15)
    assert len(solver.drifts) == len(solver.kicks) + 1
    passed, before, after, drifts = np.array(solver.stages).T
    np.testing.assert_allclose(before + after, solver.kicks, atol=1e-15)
    np.testing.assert_allclose(np.append(before, 0.0) + np.append(0.0, after), solver.drifts, atol=1e-13)
    np.testing.assert_allclose(passed, np.cumsum(solver.drifts)[:-1], atol=1e-15)
    assert sum(drifts) == pytest.approx(1.0, abs=1e-15)


STEPS = {"StormerVerlet": 400, "BlanesMoan4": 60, "BlanesMoan6": 40, "ABA864": 60}


@pytest.mark.parametrize(
    ("solver", "n"), [*((s, 1) for s in SOLVERS), *((s, 2) for s in GENERAL), (jaxrod.BlanesMoan6(), 0)], ids=_name
)
def test_observed_order(scene, uniform, solver, n):
    """Of the tip's position when the step is halved, on all splits the solver is made for."""
    system = scene(basis=jaxrod.Ritz(n), gravity=9.81, rod=uniform)
    start = system.state(angle=0.3, rate=9.0)

    def tip(n_steps):
        return jaxrod.simulate(system, start, t1=0.5, solver=solver, n_steps=n_steps).tip[-1]

    count = STEPS[type(solver).__name__] * (4 if n == 2 else 1) if n else 8
    errors = [float(jnp.max(jnp.abs(tip(count * k) - tip(count * 8 * k)))) for k in (1, 2)]
    order = np.log2(errors[0] / errors[1])
    # With small kicks ABA864 is better than its order 4 until the steps are very short.
    highest = 8.6 if isinstance(solver, jaxrod.ABA864) else solver.accuracy + 0.4
    assert solver.accuracy - 0.3 < order < highest, errors


@pytest.mark.parametrize("n", [1, 2])
def test_a_step_back_undoes_a_step(scene, n):
    system = scene(jaxrod.Spherical(), jaxrod.Ritz(n), gravity=9.81)
    start = system.state(rate=9.0, azimuth_rate=4.0, strain=0.02)
    split, solver = system.split(start), jaxrod.ABA864()
    y0 = split.encode(start)
    y1 = single_step(solver, split, 0.0, 5e-3, y0)
    back = single_step(solver, split, 5e-3, -5e-3, y1)
    for a, b, far in zip(*(jax.tree.leaves(y) for y in (y0, back, y1)), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13)
        assert np.all((np.abs(a - far) > 1e-9) | (a == far))


@pytest.mark.parametrize("n", [1, 2])
def test_dense_output_is_of_full_order(scene, n):
    """Between steps as exact as at their ends: through Diffrax, with its SaveAt."""
    system = scene(basis=jaxrod.Ritz(n), gravity=9.81)
    start, ts = system.state(rate=12.0), jnp.linspace(0.013, 0.4, 7)
    solver = jaxrod.default_solver(system)
    given = {"t1": 0.4, "solver": solver, "saveat": diffrax.SaveAt(ts=ts)}
    dense = jaxrod.simulate(system, start, n_steps=60, **given)
    at_ends = jaxrod.simulate(system, start, ts=ts, solver=solver, n_steps=600)
    np.testing.assert_allclose(dense.tip, at_ends.tip, atol=3e-8)
    np.testing.assert_allclose(dense.angle, at_ends.angle, atol=3e-8)


def test_events_and_meters_are_diffrax_s(scene):
    """The first time the rod hangs, by Newton's method within a step; a progress meter is accepted."""
    system = scene(gravity=9.81)

    def hanging(t, state, args, **_):
        return state.direction[0]

    run = {"t1": 2.0, "n_steps": 400, "solver": jaxrod.BlanesMoan6(), "progress_meter": diffrax.TextProgressMeter()}
    sol = jaxrod.simulate(system, system.state(), event=diffrax.Event(hanging), **run)
    exact = jaxrod.simulate(system, system.state(), t1=2.0, solver=diffrax.Dopri8(), event=diffrax.Event(hanging))
    np.testing.assert_allclose(sol.ts, exact.ts, rtol=1e-3)


def test_as_a_diffrax_solver(scene):
    """The split makes a term, and `diffrax.diffeqsolve` does the rest."""
    system = scene(gravity=9.81)
    start = system.state(rate=15.0)
    split = system.split(start)
    raw = diffrax.diffeqsolve(SplitTerm(split), jaxrod.BlanesMoan6(), 0.0, 0.2, 1e-3, split.encode(start))
    end = split.decode(0.2, jax.tree.map(lambda x: x[-1], raw.ys), 0.0)
    sol = jaxrod.simulate(system, start, t1=0.2, n_steps=200)
    np.testing.assert_allclose(system.tip(end), sol.tip[-1], atol=1e-12)


@pytest.mark.slow
def test_steps_are_chosen_by_the_tolerance(scene):
    """Errors of a run are below what is asked, and more is asked by more steps."""
    for n in (0, 1, 2):
        system = scene(basis=jaxrod.Ritz(n), gravity=9.81)
        start = system.state(rate=15.0)
        exact = jaxrod.simulate(system, start, t1=1.0, tolerance=1e-12, solver=None)
        steps = []
        for tolerance in (1e-6, 1e-8, 1e-10):
            sol = jaxrod.simulate(system, start, t1=1.0, tolerance=tolerance)
            periods = jaxrod.natural_frequencies(system)[0] if n else 2.0
            assert jnp.max(jnp.abs(sol.tip - exact.tip)) < max(tolerance * periods / 1000, 2e-12), (n, tolerance)
            steps.append(int(sol.stats["num_steps"]))
        assert steps == sorted(steps) and steps[0] < steps[-1] / 2


@pytest.mark.slow
def test_why(scene):
    """`stats` says which road was taken and why, through transformations too."""
    system = scene(gravity=9.81)
    start = system.state(rate=5.0)
    assert "flat" in jaxrod.simulate(system, start, t1=0.1).stats["why"]
    two = scene(basis=jaxrod.Ritz(2), gravity=9.81)
    assert "exact" in jaxrod.simulate(two, two.state(rate=5.0), t1=0.1).stats["why"]
    mapped = jax.vmap(lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=0.1))(jnp.ones(2))
    assert "flat" in mapped.stats["why"]
    damped = scene(gravity=9.81, forces=[jaxrod.PivotFriction(0.1)])
    assert "rates" in jaxrod.simulate(damped, damped.state(rate=5.0), t1=0.1).stats["why"]
    assert "as given" in jaxrod.simulate(system, start, t1=0.1, solver=diffrax.Tsit5()).stats["why"]
    assert "saveat" in jaxrod.simulate(system, start, t1=0.1, saveat=diffrax.SaveAt(t1=True)).stats["why"]


@pytest.mark.slow
def test_where_equal_steps_fail_others_are_taken(scene):
    """A fall through the pivot ends equal steps; known numbers are run again with steps that adapt."""
    system = scene()
    start = system.state(rate=1e-3, strain_rate=-200.0)
    sol = jaxrod.simulate(system, start, t1=0.1, throw=False)
    assert "adaptive" in sol.stats["why"] and sol.method.startswith("Dopri8")
    traced = jax.jit(lambda rate: jaxrod.simulate(system, system.state(rate=rate, strain_rate=-200.0), t1=0.1))(1e-3)
    assert (traced.result == Result.collapsed) | (traced.result == Result.coarse)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2])
def test_energy_has_no_trend(scene, n):
    """100 s of Figure 2, 2,500 axial periods: within 1e-10, and the second half no worse than the first."""
    system = scene(basis=jaxrod.Ritz(n), gravity=9.81)
    sol = jaxrod.simulate(system, system.state(rate=15.0), ts=jnp.linspace(0.0, 100.0, 1001))
    error = np.abs(np.asarray(sol.energy / sol.energy[0]) - 1)
    assert error.max() < 1e-10
    assert error[501:].mean() < 2 * error[1:501].mean() + 1e-13


# ---- derivatives


@pytest.mark.slow
@pytest.mark.parametrize(("n", "motion"), [(1, jaxrod.Rotation()), (2, jaxrod.Spherical())])
def test_backwards_is_forwards(scene, cone, n, motion):
    """The reversible adjoint against forward sensitivities to rounding, and central differences to 1e-7."""

    def answer(p, adjoint=None):
        system = scene(motion, jaxrod.Ritz(n), 9.81 * p[2], rod=cone, young=1e7 * p[0], length=p[1])
        more = {"azimuth_rate": 4.0 * p[3]} if motion.dimension == 3 else {}
        start = system.state(angle=0.2, rate=8.0 * p[3], **more)
        sol = jaxrod.simulate(system, start, ts=jnp.linspace(0.0, 0.5, 6), adjoint=adjoint)
        return jnp.sum(sol.tip**2 @ jnp.arange(1.0, motion.dimension + 1)) + sol.strain[-1]

    p = jnp.ones(4)
    backwards = jax.grad(answer)(p)
    forwards = jax.jacfwd(lambda p: answer(p, diffrax.ForwardMode()))(p)
    np.testing.assert_allclose(backwards, forwards, rtol=1e-10)

    h = 1e-5
    central = [(answer(p.at[i].add(h)) - answer(p.at[i].add(-h))) / (2 * h) for i in range(4)]
    np.testing.assert_allclose(backwards, central, rtol=1e-7 * 20, atol=1e-7 * float(jnp.max(jnp.abs(backwards))))


def test_derivative_by_the_end_time_is_the_rate(scene):
    system = scene(gravity=9.81)
    start = system.state(rate=15.0)
    sol = jaxrod.simulate(system, start, t1=0.7)
    slope = jax.grad(lambda t1: jaxrod.simulate(system, start, t1=t1).angle[-1])(0.7)
    np.testing.assert_allclose(slope, sol.rate[-1], rtol=1e-9)


def test_memory_of_the_derivative_does_not_grow_with_the_steps(scene):
    """The compiled program keeps as much for ten times the steps."""
    system = scene(gravity=9.81)

    def end(rate, n_steps):
        return jaxrod.simulate(
            system, system.state(rate=rate), t1=1.0, n_steps=n_steps, solver=jaxrod.BlanesMoan6()
        ).tip[0, 0]

    sizes = []
    for n_steps in (100, 1000):
        compiled = jax.jit(jax.grad(end), static_argnums=1).lower(15.0, n_steps).compile()
        sizes.append(compiled.memory_analysis().temp_size_in_bytes)
    assert sizes[1] <= sizes[0] + 1024


def test_reversible_needs_a_symplectic_solver(scene):
    system = scene(gravity=9.81)
    with pytest.raises(ValueError, match=r"Reversible\(\) runs symplectic solvers backwards, not Tsit5"):
        jaxrod.simulate(system, system.state(), t1=0.1, solver=diffrax.Tsit5(), adjoint=jaxrod.Reversible())


def test_refusals(scene):
    system = scene(basis=jaxrod.Ritz(2), gravity=9.81)
    start = system.state()
    with pytest.raises(ValueError, match=r"BlanesMoan6\(\) keeps its order for uniform strain.*take ABA864"):
        jaxrod.simulate(system, start, t1=0.1, solver=jaxrod.BlanesMoan6())
    with pytest.raises(ValueError, match=r"ABA864\(\) has coordinates of its own; leave out chart="):
        jaxrod.simulate(system, start, t1=0.1, solver=jaxrod.ABA864(), chart=jaxrod.Angles())
    pendulum = jaxrod.Lagrangian(lambda t, q, v: v @ v / 2 + jnp.cos(q[0]))
    with pytest.raises(ValueError, match="any Lagrangian"):
        jaxrod.simulate(pendulum, (jnp.zeros(1), jnp.zeros(1)), t1=0.1, solver=jaxrod.ABA864())


# ---- forces that depend on rates


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "n"), [(jaxrod.Spherical(), 1), (jaxrod.Rotation(), 0), (jaxrod.Rotation(), 3)])
def test_unrolled(scene, motion, n):
    """Damped scenes by equal steps in one loop, against Diffrax's adaptive run."""
    system = scene(motion, jaxrod.Ritz(n), gravity=9.81, forces=[jaxrod.PivotFriction(0.3)])
    start, ts = system.state(angle=0.2, rate=12.0), jnp.linspace(0.05, 0.5, 10)
    exact = jaxrod.simulate(system, start, ts=ts, tolerance=1e-11)
    sol = jaxrod.simulate(system, start, ts=ts, solver=jaxrod.Unrolled(), n_steps=4000)
    np.testing.assert_allclose(sol.tip, exact.tip, atol=1e-8)
    np.testing.assert_allclose(sol.angle, exact.angle, atol=1e-8)
    slope = jax.jacfwd(
        lambda rate: jaxrod.simulate(
            system,
            system.state(rate=rate),
            t1=0.2,
            n_steps=400,
            solver=jaxrod.Unrolled(),
            adjoint=diffrax.ForwardMode(),
        ).angle[-1]
    )(12.0)
    reverse = jax.grad(lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=0.2).angle[-1])(12.0)
    np.testing.assert_allclose(slope, reverse, rtol=1e-6)


def test_unrolled_refuses():
    with pytest.raises(ValueError, match="is no explicit Runge-Kutta method"):
        jaxrod.Unrolled(diffrax.Kvaerno5())


@pytest.mark.parametrize(
    "forces",
    [
        [jaxrod.Torque(lambda t, state: 10 * jnp.sin(300 * t))],
        [jaxrod.TipForce(lambda t, state: 300 * jnp.sin(4000 * t) * state.direction)],
    ],
    ids=["torque", "tip force"],
)
def test_fast_loads_are_resolved(scene, forces):
    """Loads faster than anything that the steps are counted by: seen by half the steps, and taken by others."""
    system = scene(gravity=9.81, forces=forces)
    start = system.state(rate=3.0)
    sol = jaxrod.simulate(system, start, t1=0.3)
    fine = jaxrod.simulate(system, start, t1=0.3, n_steps=20000)
    assert jnp.max(jnp.abs(sol.tip - fine.tip)) < 1e-8


@pytest.mark.slow
def test_a_pulse_is_met(scene):
    """Of 20 us in a second: where equal steps met it, those that adapt do not step over it."""
    pulse = jaxrod.Torque(lambda t, state: 1e5 * jnp.exp(-(((t - 0.5037) / 2e-5) ** 2)))
    system = scene(gravity=9.81, forces=[pulse])
    sol = jaxrod.simulate(system, system.state(rate=3.0), t1=1.0)
    fine = jaxrod.simulate(system, system.state(rate=3.0), t1=1.0, n_steps=400_000)
    np.testing.assert_allclose(sol.tip, fine.tip, atol=1e-7)


@pytest.mark.slow
def test_numbers_in_closures(scene, cone):
    """A load or a motion that closes over a traced number has derivatives, and maps."""

    def tip(p):
        system = scene(forces=[jaxrod.Torque(lambda t, state: p * 50 * t)], rod=cone)
        return jaxrod.simulate(system, system.state(), t1=0.1).angle[-1]

    less, more = jax.vmap(tip)(jnp.array([0.999, 1.001]))
    np.testing.assert_allclose(less, tip(0.999), atol=1e-10)
    np.testing.assert_allclose(jax.grad(tip)(1.0), (more - less) / 0.002, rtol=1e-5)

    def swept(p):
        return jaxrod.sweep(lambda rate: jnp.sin(p * rate), jnp.array([1.0, 2.0])).sum()

    np.testing.assert_allclose(jax.grad(swept)(0.5), jnp.cos(0.5) + 2 * jnp.cos(1.0))


def test_numbers_that_hide_nowhere(scene, cone):
    """The leaves of a `Partial` are seen: such scenes keep to equal steps.  A module within a closure hides its own."""

    def driven(rate):
        system = scene(jaxrod.Driven(jax.tree_util.Partial(lambda w, t: w * t, rate)), rod=cone)
        return jaxrod.simulate(system, system.state(), t1=0.05)

    def loaded(moment):
        load = jaxrod.Torque(moment)
        system = scene(forces=[jaxrod.Torque(lambda t, state: load.moment * t)], rod=cone)
        return jaxrod.simulate(system, system.state(), t1=0.05)

    assert jax.jit(driven)(5.0).stats["why"].startswith("symplectic")
    assert "closes over" in jax.jit(loaded)(5.0).stats["why"]


def test_what_failed_has_no_derivative(scene):
    """Not zero, which would pass for one."""
    system = scene()

    def strain(rate):
        return jaxrod.simulate(system, system.state(strain_rate=rate), t1=0.05, throw=False).strain[-1]

    slopes = jax.vmap(jax.grad(strain))(jnp.array([-1.0, -200.0]))
    assert jnp.isfinite(slopes[0]) and jnp.isnan(slopes[1])


@pytest.mark.parametrize("how", [{"solver": jaxrod.BlanesMoan6(), "n_steps": 1500}, {"dt0": 0.01}], ids=str)
@pytest.mark.parametrize("forwards", [False, True])
def test_what_was_reached_before_a_stop_has_its_derivative(scene, how, forwards):
    """And what was not reached has none, by the start or by the rod."""
    ts = jnp.array([0.1, 0.2, 5.0])
    adjoint = {"adjoint": diffrax.ForwardMode()} if forwards else {}

    def heights(numbers, **stops):
        system = scene(young=1e7 * numbers[1], gravity=9.81)
        sol = jaxrod.simulate(system, system.state(rate=numbers[0]), ts=ts, throw=False, **how, **stops, **adjoint)
        return sol.states.direction[:, 1]

    derivative, numbers = jax.jacfwd if forwards else jax.jacrev, jnp.array([10.0, 1.0])
    found = derivative(lambda x: heights(x, max_steps=60))(numbers)
    np.testing.assert_allclose(found[:2], derivative(heights)(numbers)[:2], rtol=1e-6)
    assert jnp.isnan(found[2]).all()


def test_what_was_not_reached_has_none_however_it_moves(scene):
    """Also along a way that moves two numbers against each other."""
    system, ts = scene(gravity=9.81), jnp.array([0.1, 5.0])

    def heights(x):
        start = system.state(rate=10.0, strain=0.01 + x, strain_rate=-x)
        run = {"solver": jaxrod.BlanesMoan6(), "n_steps": 1500, "max_steps": 60, "adjoint": diffrax.ForwardMode()}
        return jaxrod.simulate(system, start, ts=ts, throw=False, **run).states.direction[:, 1]

    _, along = jax.jvp(heights, (0.0,), (1.0,))
    assert jnp.isfinite(along[0]) and jnp.isnan(along[1])


def test_solvers_whose_steps_nobody_counts(scene):
    system = scene(gravity=9.81)
    with pytest.raises(ValueError, match="n_steps="):
        jaxrod.simulate(system, system.state(), t1=0.1, solver=jaxrod.StormerVerlet())


@pytest.mark.parametrize("n_steps", [800, 4000])
def test_turns_are_counted_where_steps_open_and_close(scene, n_steps):
    """A run may pass the place where turns are counted in the drift before its first step, or stand just before it."""
    system = scene()
    ts = jnp.linspace(0.0, 0.04, 801)[1:]
    run = {"ts": ts, "n_steps": n_steps, "solver": jaxrod.ABA864()}
    angle = jaxrod.simulate(system, system.state(angle=np.pi - 0.3, rate=15.0), **run).angle
    assert jnp.max(jnp.abs(jnp.diff(angle))) < 1e-3
    just_before = jaxrod.simulate(system, system.state(angle=np.pi - 1e-5, rate=15.0), **run).angle
    np.testing.assert_allclose(just_before - angle, 0.3, atol=1e-4)
