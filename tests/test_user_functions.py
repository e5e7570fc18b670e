"""Functions that a user may give: of every kind that Python has, with whole numbers and lists for answers."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.core import calling


class Steady(eqx.Module):
    most: jax.Array

    def __call__(self, t, state):
        return self.most + 0 * t

    def method(self, t, state):
        return self.most + 0 * t


class Plain:
    def __call__(self, t, state):
        return 2.0 + 0 * t


KINDS = {
    "module": Steady(jnp.asarray(2.0)),
    "method": Steady(jnp.asarray(2.0)).method,
    "object": Plain(),
    "partial": functools.partial(lambda most, t, state: most + 0 * t, 2.0),
    "Partial": jax.tree_util.Partial(lambda most, t, state: most + 0 * t, 2.0),
    "jitted": jax.jit(lambda t, state: 2.0 + 0 * t),
    "whole number": lambda t, state: 2,
    "NumPy's number": lambda t, state: np.float32(2.0),
    "optional argument": lambda t, state, more=0.0: 2.0 + more,
}


@pytest.mark.parametrize("moment", KINDS.values(), ids=KINDS)
def test_kinds_of_functions(moment, scene, uniform):
    system = scene(forces=[jaxrod.Torque(moment)], rod=uniform)
    power = system.power(0.0, system.state(rate=3.0))
    np.testing.assert_allclose(power, 6.0, rtol=1e-12)


def test_whole_numbers_and_lists(scene, uniform):
    shaken = jaxrod.ShakenBase(lambda t: [0, 1])
    pulled = jaxrod.TipForce(lambda t, state: [0, 2])
    rubbed = jaxrod.PivotFriction(lambda t, state: 0)
    system = scene(forces=[shaken, pulled, rubbed], rod=uniform)
    assert system.power(0.0, system.state(rate=3.0)) == 6.0
    turned = jaxrod.Torque(lambda t, state: [0, -2, 0])
    space = scene(jaxrod.Spherical(), forces=[turned], rod=uniform)
    np.testing.assert_allclose(space.power(0.0, space.state(rate=3.0)), 6.0, rtol=1e-12)
    thick = jaxrod.Rod(1.0, lambda s: 1, young=lambda s: 10**7, density=lambda s: 1200)
    np.testing.assert_allclose(thick.mass, 1200.0, rtol=1e-12)
    resting = scene(jaxrod.Driven(lambda t: 1), rod=uniform)
    assert resting.state().angle == 1.0 and resting.state().rate == 0.0


def test_functions_that_close_over_traced_numbers(scene, uniform):
    def power(most):
        forces = [jaxrod.Torque(lambda t, state: most * jnp.cos(t)), jaxrod.PivotFriction(lambda t, state: most)]
        system = scene(forces=forces, rod=uniform)
        return system.power(0.0, system.state(rate=3.0))

    np.testing.assert_allclose(jax.jit(power)(2.0), -12.0, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(jax.grad(power))(jnp.ones(3)), -6.0, rtol=1e-12)

    def mass(area):
        return jaxrod.Rod(1.0, lambda s: area + 0 * s, 1e7, 1200.0).mass

    np.testing.assert_allclose(jax.vmap(jax.grad(mass))(jnp.ones(3)), 1200.0, rtol=1e-12)


def test_a_force_of_ones_own_is_asked_whether_it_is_linear(scene, uniform):
    class Drag(jaxrod.AbstractForce):
        coefficient: jax.Array

        def power(self, t, state, virtual, body):
            speed = jnp.sqrt(state.direction_rate @ state.direction_rate)
            return -self.coefficient * speed * (state.direction_rate @ virtual.direction)

        def check(self, motion):
            pass

    def power(coefficient):
        system = scene(forces=[Drag(coefficient)], rod=uniform)
        return system.power(0.0, system.state(rate=3.0))

    np.testing.assert_allclose(power(jnp.asarray(2.0)), -54.0, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(jax.grad(power))(2.0), -27.0, rtol=1e-12)


@pytest.mark.parametrize("n", [2, np.int64(2), np.int32(2)])
def test_whole_numbers_of_numpy_count(n, scene, uniform):
    system = scene(basis=jaxrod.Ritz(n), rod=uniform)
    assert type(system.basis.n) is int
    assert jaxrod.continuum.natural_frequencies(system, n).shape == (2,)
    assert jaxrod.sweep(lambda x: x, jnp.ones(3), block=n).shape == (3,)
    rigid = scene(basis=jaxrod.Ritz(0), rod=uniform)
    assert jaxrod.simulate(rigid, rigid.state(rate=1.0), t1=0.1, n_steps=n, max_steps=n).ok


def test_a_scene_without_functions_traces_nothing(scene, monkeypatch):
    """Nor does a rod; what it costs is left to functions."""

    def traced(*given, **named):
        raise AssertionError("something was tried")

    monkeypatch.setattr(calling, "rehearsed", traced)
    scene(None, jaxrod.Ritz(3), 9.81, [jaxrod.Torque(1.0), jaxrod.KelvinVoigt(1e-3)])


def test_viscosity_is_left_out_where_the_strain_has_no_rate(scene, uniform):
    system = scene(forces=[jaxrod.KelvinVoigt(1e-3), jaxrod.PivotFriction(0.1)], rod=uniform)
    for basis, count in ((jaxrod.Ritz(0), 1), (jaxrod.QuasiStatic(jaxrod.Ritz(2)), 1), (jaxrod.Ritz(2), 2)):
        other, _ = jaxrod.ladder.on_rung(system, system.state(), basis)
        assert len(other.forces) == count


@pytest.mark.slow
@pytest.mark.parametrize(("time", "told"), [(1.0, True), (1e-5, False)])
def test_overdamped_runs_are_told_of_an_implicit_solver(time, told, scene, uniform):
    system = scene(forces=[jaxrod.KelvinVoigt(time)], rod=uniform)
    with pytest.raises(jaxrod.SimulationError) as caught:
        jaxrod.simulate(system, system.state(strain=0.01), t1=2.0, max_steps=20)
    remedy = "damping is stiffer than any vibration: take solver=diffrax.Kvaerno5(), chart=jaxrod.Director()"
    assert (remedy in str(caught.value)) == told


@pytest.mark.slow
@pytest.mark.parametrize("motion", [jaxrod.Rotation(), jaxrod.Spherical()], ids=["plane", "space"])
def test_an_implicit_solver_steps_overdamped_rods(motion, scene, uniform):
    """By what `simulate` says: a tenth of the explicit steps, and the same motion."""
    system = scene(motion, None, 9.81, [jaxrod.KelvinVoigt(1.0)], rod=uniform)
    start = system.state(strain=0.01, rate=1.0)
    explicit = jaxrod.simulate(system, start, t1=2.0)
    implicit = jaxrod.simulate(system, start, t1=2.0, solver=diffrax.Kvaerno5(), chart=jaxrod.Director())
    assert implicit.stats["num_steps"] < explicit.stats["num_steps"] / 3
    np.testing.assert_allclose(implicit.angle, explicit.angle, rtol=1e-7)
    np.testing.assert_allclose(implicit.strain, explicit.strain, rtol=1e-6)
