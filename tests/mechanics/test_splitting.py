"""Exact flows: each against the equations that automatic differentiation makes of its part of the energy."""

import dataclasses

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod
from jaxrod.core.lanes import alone, laned, spread
from jaxrod.integrators.symplectic import single_step
from jaxrod.mechanics import energy
from jaxrod.mechanics.splittings.driven_rotation import DrivenRotationSplitting
from jaxrod.mechanics.splittings.free_rotation import FreeRotationSplitting
from jaxrod.mechanics.splittings.uniform_strain import UniformStrainSplitting

SPACE = {"azimuth": 0.4, "azimuth_rate": 3.0}
LOADS = (
    jaxrod.TipForce(lambda t, state: jnp.sin(3 * t + 1) * jnp.ones_like(state.direction)),
    jaxrod.ShakenBase(lambda t: 0.01 * jnp.stack([jnp.sin(9 * t), jnp.cos(7 * t)])),
    jaxrod.Torque(lambda t, state: 0.3 * jnp.cos(t) * state.direction[0]),
)
SCENES = {
    "flat": (jaxrod.Rotation(), jaxrod.Ritz(1), 9.81, (), {}),
    "flat, loads": (jaxrod.Rotation(), jaxrod.Ritz(1), 9.81, LOADS, {}),
    "flat in space": (jaxrod.Spherical(), jaxrod.Ritz(1), jnp.array([1.0, 2.0, -9.0]), (), SPACE),
    "flat in flight": (jaxrod.Flight(), jaxrod.Ritz(1), 9.81, (), {"center_velocity": (1.0, 2.0)}),
    "axial": (jaxrod.Rotation(), jaxrod.Ritz(3), 9.81, (), {}),
    "axial, loads": (jaxrod.Rotation(0.3), jaxrod.LoadRitz(2), 9.81, LOADS, {}),
    "axial in space": (jaxrod.Spherical(), jaxrod.ForceRitz(2), None, (), SPACE),
    "axial in flight": (jaxrod.Flight(), jaxrod.Ritz(2), 9.81, (), {"center_velocity": (1.0, 2.0)}),
    "rigid": (jaxrod.Rotation(), jaxrod.Ritz(0), 9.81, (), {}),
    "rigid in space": (jaxrod.Spherical(), jaxrod.Ritz(0), 9.81, (), SPACE),
    "driven": (jaxrod.Driven(lambda t: 10 * t + jnp.sin(3 * t)), jaxrod.Ritz(2), 9.81, LOADS[:1], {}),
}


def _scene(name):
    motion, basis, gravity, forces, more = SCENES[name]
    system = scene(motion, basis, gravity, forces)
    turning = {} if isinstance(motion, jaxrod.Driven) else {"angle": 0.3, "rate": 12.0, **more}
    amplitudes = jnp.array([0.02, -0.01, 0.005])[: basis.n]
    return system, system.state(**turning, amplitudes=amplitudes, amplitude_rates=3 * amplitudes)


@pytest.mark.parametrize("name", SCENES)
def test_the_flows_add_up_to_the_equations_of_motion(name):
    """d/dh of a step, at h = 0, is the vector field from autodiff of the Lagrangian."""
    system, start = _scene(name)
    split = system.split(start)
    if isinstance(system.motion, jaxrod.Driven):
        chart = jaxrod.Strains()
    else:
        chart = jaxrod.Angles() if system.motion.dimension == 2 else jaxrod.Director()

    def ahead(h):
        y = single_step(jaxrod.BlanesMoan4(), split, 0.0, h, split.encode(start))
        return split.decode(h, y, start.turns)

    rates = jax.jvp(ahead, (0.0,), (1.0,))[1]
    equations = system.equations(chart)
    q, v = equations.encode(0.0, start)
    expected = jax.jvp(
        lambda t, q, v: equations.decode(t, q, v), (0.0, q, v), (1.0, v, equations.acceleration(0.0, q, v))
    )[1]
    for found, right in zip(jax.tree.leaves(rates), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(found, right, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("name", SCENES)
def test_stages_are_undone(name):
    """From after a stage back to before it, to rounding; and the derivative of a known circle is that of its angle."""
    system, start = _scene(name)
    split, solver, h = system.split(start), jaxrod.ABA864(), 4e-3

    @jax.jit
    @laned
    def there_and_back(split, h, y):
        table = split.table(solver, h)

        def visit(carry, stage, known):
            y, off = carry
            y1 = split.stage(stage, known, 0.1 + 0 * h, h, y)
            back = split.inverse_stage(stage, known, 0.1 + 0 * h, h, split.normalized(y1))
            differences = jax.tree.map(lambda a, b: jnp.max(jnp.abs(a - b), initial=0.0), back, split.normalized(y))
            return y1, jnp.maximum(off, jnp.max(jnp.stack(jax.tree.leaves(differences))))

        return split.scan_stages(solver, table, visit, (split.enter(solver, table, 0.1 + 0 * h, h, y), 0.0))

    y0 = split.encode(start)
    y1, off = there_and_back(*spread((split, h, y0)))
    assert off < 1e-12
    ways = jax.tree.map(lambda a, b: jnp.max(jnp.abs(a - b), initial=0.0), y0, alone(y1))
    assert max(jax.tree.leaves(ways)) > 1e-3


def _run(energy, y, t):
    """Hamilton's equations of one part of the energy, by autodiff and a tight adaptive solver."""

    def field(_, y, args):
        q, p = y
        dq, dp = jax.grad(energy, argnums=(0, 1))(q, p)
        return dp, -dq

    tight = diffrax.PIDController(rtol=1e-13, atol=1e-13)
    term, solver = diffrax.ODETerm(field), diffrax.Dopri8()
    run = diffrax.diffeqsolve(term, solver, 0.0, t, 1e-3, y, stepsize_controller=tight, max_steps=2**16)
    return jax.tree.map(lambda x: x[-1], run.ys)


PARTS = {
    "drift": lambda m, eta, p, psi, L: (p @ p + (m.rates * eta) @ (m.rates * eta) + L**2 * (1 - 2 * m.arms @ eta)) / 2,
    "turning": lambda m, eta, p, psi, L: L**2 * (1 / m.inertia(eta) - 1 + 2 * m.arms @ eta) / 2,
    "gravity": lambda m, eta, p, psi, L: 9.81 * m.moment(eta) * jnp.sin(psi),
}


@pytest.mark.parametrize("part", PARTS)
def test_each_axial_flow_is_exact(part):
    """q = (eta, psi), p = (p, l): the flow of a part of the energy alone, to 1e-12."""
    system, start = _scene("axial")
    split = system.split(start)
    modes, t = split.modes, 0.02
    y = split.encode(start)
    eta, psi, p, momentum = y.strain, 0.3, y.strain_momentum * modes.rates, y.p[0]

    def energy(q, p):
        return PARTS[part](modes, q[:-1], p[:-1], q[-1], p[-1])

    q1, p1 = _run(energy, (jnp.append(eta, psi), jnp.append(p, momentum)), t)

    flows = {
        "drift": lambda split, t, y: split.normalized(split._drift(split._circle(t), t, y)),
        "turning": lambda split, t, y: split.normalized(split._straighten(t, y)),
        "gravity": lambda split, t, y: split._load(0 * t, t, y),
    }
    found = alone(laned(flows[part])(*spread((split, t, y))))
    np.testing.assert_allclose(found.strain, q1[:-1], atol=1e-12)
    np.testing.assert_allclose(found.strain_momentum * modes.rates, p1[:-1], atol=2e-11)
    np.testing.assert_allclose(found.p[0], p1[-1], rtol=1e-12)
    np.testing.assert_allclose(found.q, [jnp.cos(q1[-1]), jnp.sin(q1[-1])], atol=1e-12)
    if part != "gravity":
        assert abs(q1[-1] - psi) > 1e-4, "nothing turned"


def test_the_flat_kick_is_minus_the_gradient_of_the_energy():
    system, start = _scene("flat")
    split, q = system.split(start), jnp.array([0.7, 0.9])
    inertia = system.body.mass_matrix[0, 0]

    def potential(q):
        state = dataclasses.replace(start, direction=q / jnp.sqrt(q @ q), amplitudes=(jnp.sqrt(q @ q) - 1)[None])
        return system.elastic_energy(state) + system.gravity_energy(state)

    found = alone(laned(type(split).force)(*spread((split, 0.0, q))))
    np.testing.assert_allclose(found, -jax.grad(potential)(q) / inertia, rtol=1e-12)


def test_which_split():
    kinds = {name: type(_scene(name)[0].split(_scene(name)[1])) for name in SCENES}
    assert {kinds[name] for name in SCENES if name.startswith("flat")} == {UniformStrainSplitting}
    assert kinds["driven"] is DrivenRotationSplitting
    assert {kinds[name] for name in SCENES if name.startswith(("axial", "rigid"))} == {FreeRotationSplitting}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"forces": (jaxrod.PivotFriction(0.1),)}, "rates"),
        ({"forces": (jaxrod.Torque(lambda t, state: -state.angle),)}, "turns"),
        ({"basis": jaxrod.QuasiStatic(jaxrod.Ritz(1))}, "QuasiStatic"),
    ],
)
def test_what_cannot_be_split_says_so(change, why):
    system = scene(**change)
    assert why in system.unsplit
    with pytest.raises(ValueError, match="symplectic"):
        system.split(system.state())
    with pytest.raises(ValueError, match=r"solver=BlanesMoan4\(\) cannot step this scene"):
        jaxrod.simulate(system, system.state(), t1=1.0, solver=jaxrod.BlanesMoan4(), n_steps=10)
    assert type(jaxrod.default_solver(system)) is diffrax.Dopri8


@pytest.mark.slow  # what was compiled is forgotten twice
def test_one_energy_makes_the_default_run(scene, monkeypatch):
    """What `energy.py` says is what moves: with another energy of weight the default run is another one, by as much."""
    system = scene(basis=jaxrod.Ritz(2), gravity=9.81)
    heavier = scene(basis=jaxrod.Ritz(2), gravity=2 * 9.81)
    expected = jaxrod.simulate(heavier, heavier.state(rate=12.0), t1=0.2, n_steps=300, solver=jaxrod.ABA864())
    weight = energy.gravity_pivoted
    monkeypatch.setattr(energy, "gravity_pivoted", lambda *x: 2 * weight(*x))
    jax.clear_caches()
    found = jaxrod.simulate(system, system.state(rate=12.0), t1=0.2, n_steps=300, solver=jaxrod.ABA864())
    monkeypatch.undo()
    jax.clear_caches()
    np.testing.assert_allclose(found.tip, expected.tip, rtol=1e-12)
