"""Exact flows: each against the equations that automatic differentiation makes of its part of the energy."""

import dataclasses

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod
from jaxrod.core.scalarize import gathered, scattered
from jaxrod.integrators.splitting import Split
from jaxrod.integrators.symplectic import single_step
from jaxrod.mechanics.splittings.driven_rotation import Prescribed
from jaxrod.mechanics.splittings.free_rotation import Axial
from jaxrod.mechanics.splittings.uniform_strain import Flat

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
    def there_and_back(y):
        table = split.table(solver, h)

        def visit(carry, stage, known):
            y, off = carry
            y1 = split.stage(stage, known, 0.1, h, y)
            back = split.undone(stage, known, 0.1, h, split.settled(y1))
            differences = jax.tree.map(lambda a, b: jnp.abs(a - b), back, split.settled(y))
            return y1, jnp.maximum(off, jnp.max(jnp.stack(jax.tree.leaves(differences))))

        return split.through(solver, table, visit, (split.opened(solver, table, 0.1, h, y), 0.0))

    y0 = split.encode(start)
    y1, off = there_and_back(y0)
    assert off < 1e-12
    assert max(abs(a - b) for a, b in zip(jax.tree.leaves(y0), jax.tree.leaves(y1), strict=True)) > 1e-3


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
    eta, psi, p, momentum = gathered(y.strain), 0.3, gathered(y.strain_momentum) * modes.rates, y.p[0]

    def energy(q, p):
        return PARTS[part](modes, q[:-1], p[:-1], q[-1], p[-1])

    q1, p1 = _run(energy, (jnp.append(eta, psi), jnp.append(p, momentum)), t)

    flows = {
        "drift": lambda y: split.settled(split._drift(split._circle(t), t, y)),
        "turning": lambda y: split.settled(split._straighten(t, y)),
        "gravity": lambda y: split._load(0.0, t, y),
    }
    found = flows[part](y)
    np.testing.assert_allclose(gathered(found.strain), q1[:-1], atol=1e-12)
    np.testing.assert_allclose(gathered(found.strain_momentum) * modes.rates, p1[:-1], atol=2e-11)
    np.testing.assert_allclose(found.p[0], p1[-1], rtol=1e-12)
    np.testing.assert_allclose(gathered(found.q), [jnp.cos(q1[-1]), jnp.sin(q1[-1])], atol=1e-12)
    if part != "gravity":
        assert abs(q1[-1] - psi) > 1e-4, "nothing turned"


def test_the_flat_kick_is_minus_the_gradient_of_the_energy():
    system, start = _scene("flat")
    split, q = system.split(start), jnp.array([0.7, 0.9])
    inertia = system.body.mass_matrix[0, 0]

    def potential(q):
        state = dataclasses.replace(start, direction=q / jnp.sqrt(q @ q), amplitudes=(jnp.sqrt(q @ q) - 1)[None])
        return system.elastic_energy(state) + system.gravity_energy(state)

    found = gathered(split.force(0.0, scattered(q)))
    np.testing.assert_allclose(found, -jax.grad(potential)(q) / inertia, rtol=1e-12)


def test_which_split():
    kinds = {name: type(_scene(name)[0].split(_scene(name)[1])) for name in SCENES}
    assert {kinds[name] for name in SCENES if name.startswith("flat")} == {Flat}
    assert kinds["driven"] is Prescribed
    assert {kinds[name] for name in SCENES if name.startswith(("axial", "rigid"))} == {Axial}


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


def test_phases_are_scalars():
    """Lanes last: under vmap every number is a vector of its own."""
    system, start = _scene("axial")
    y = system.split(start).encode(start)
    assert isinstance(y, Split)
    assert all(jnp.ndim(x) == 0 for x in jax.tree.leaves(y))
