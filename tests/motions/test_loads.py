"""Loads and drives as functions of time: none is passed over, and what cannot be seen is said.

Right values: closed forms, and SciPy's DOP853 at 1e-12 where a number is given.
"""

import dataclasses
import math
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import make_rod, scene

import jaxrod
from jaxrod.core.precision import in_type

UNIFORM = make_rod(section=jaxrod.Uniform(0.025))


def loaded(*forces, basis=None, **others):
    """Rigid unless given a basis."""
    return scene(basis=basis or jaxrod.Ritz(0), forces=forces, rod=UNIFORM, **others)


def pulse(begin, width, total=1.0):
    """A smooth blow, as a bare function."""

    def strength(t, *_):
        inside = (t > begin) & (t < begin + width)
        return jnp.where(inside, total / width * (1 - jnp.cos(2 * jnp.pi * (t - begin) / width)), 0.0)

    return strength


def record(begin, width, total=1.0, samples=201):
    part = jnp.linspace(0.0, 1.0, samples)
    return jaxrod.Record(begin + width * part, total / width * (1 - jnp.cos(2 * jnp.pi * part)))


# ---- blows


@pytest.mark.parametrize("width", [1.0, 0.01, 1e-5])
@pytest.mark.parametrize("load", [jaxrod.Impulse, record])
def test_blow_on_a_rigid_rod(uniform, width, load):
    load = load(1.0, 5.0, width) if load is jaxrod.Impulse else load(5.0, width)
    system = loaded(jaxrod.Torque(load))
    sol = jaxrod.simulate(system, system.state(), t1=10.0)
    rate = 1 / uniform.moment_of_inertia()
    np.testing.assert_allclose(sol.rate[-1], rate, rtol=1e-9)
    np.testing.assert_allclose(sol.angle[-1], rate * (5 - width / 2), rtol=1e-9)


@pytest.mark.parametrize(("begin", "width"), [(5.0, 1.0), (5.0, 0.1), (5.0, 0.01), (2.3457, 0.0103)])
def test_blow_as_a_bare_function(uniform, begin, width):
    system = loaded(jaxrod.Torque(pulse(begin, width)))
    sol = jaxrod.simulate(system, system.state(), t1=10.0)
    np.testing.assert_allclose(sol.rate[-1], 1 / uniform.moment_of_inertia(), rtol=1e-9)


def test_blow_where_steps_adapt():
    for load in (pulse(5.0, 0.1), jaxrod.Impulse(1.0, 5.0, 0.1), record(5.0, 0.1)):
        system = loaded(jaxrod.PivotFriction(0.1), jaxrod.Torque(load))
        sol = jaxrod.simulate(system, system.state(), t1=10.0)
        np.testing.assert_allclose(sol.rate[-1], 0.6779468062, rtol=1e-8)  # quadrature of the impulse response


def test_blow_on_a_rod_that_stretches(uniform):
    """What a blow along the rod leaves is an oscillation of known size: the pulse's Fourier transform at its rate."""
    width, total = 1e-4, 0.05
    system = loaded(jaxrod.TipForce(jaxrod.Impulse(total, 0.02, width)), basis=jaxrod.Ritz(1))
    sol = jaxrod.simulate(system, system.state(), ts=jnp.linspace(0.021, 0.06, 200))
    omega = 2 * jnp.pi * jaxrod.natural_frequencies(system)[0]
    x = omega * width
    transformed = jnp.sin(x / 2) / (x / 2) / (1 - (x / (2 * jnp.pi)) ** 2)
    inertia = system.body.mass_matrix[1, 1]
    amplitude = total * uniform.length * transformed / (inertia * omega)  # of the tip, z' = total l / M
    found = jnp.sqrt(sol.strain**2 + (sol.strain_rate / omega) ** 2)
    np.testing.assert_allclose(found, amplitude, rtol=1e-8)


def test_blow_between_two_looks_is_said():
    system = loaded(jaxrod.Torque(pulse(5.0006, 1e-3)))
    with pytest.warns(UserWarning, match=r"jaxrod\.Impulse, samples as jaxrod\.Record"):
        jaxrod.simulate(system, system.state(), t1=10.0)


def test_sweep_of_blows(uniform):
    """A narrow one is seen, or has a code; no lane is silently zero."""

    def rate(width):
        system = loaded(jaxrod.Torque(jax.tree_util.Partial(lambda width, t, _: pulse(5.0006, width)(t), width)))
        sol = jaxrod.simulate(system, system.state(), t1=10.0)
        return {"rate": sol.rate[-1], "result": sol.result}

    with pytest.warns(UserWarning, match="1 scenes did not end ok"):
        out = jaxrod.sweep(rate, jnp.array([3.0, 1.0, 0.3, 1e-3]))
    seen = out["result"] == jaxrod.Result.ok
    np.testing.assert_array_equal(seen, [True, True, True, False])
    np.testing.assert_allclose(out["rate"][seen], 1 / uniform.moment_of_inertia(), rtol=1e-7)
    assert out["result"][-1] == jaxrod.Result.unseen


def test_sweep_of_impulses(uniform):
    def rate(width):
        system = loaded(jaxrod.Torque(jaxrod.Impulse(1.0, 5.0, width)))
        sol = jaxrod.simulate(system, system.state(), t1=10.0)
        return {"rate": sol.rate[-1], "result": sol.result}

    out = jaxrod.sweep(rate, jnp.geomspace(1e-5, 1.0, 6))
    np.testing.assert_allclose(out["rate"], 1 / uniform.moment_of_inertia(), rtol=1e-9)


def test_given_steps_that_pass_over_a_load(uniform):
    system = loaded(jaxrod.Torque(pulse(5.0, 0.3)))
    sol = jaxrod.simulate(system, system.state(), t1=10.0, solver=jaxrod.BlanesMoan6(), n_steps=20, throw=False)
    assert sol.result == jaxrod.Result.coarse
    system = loaded(jaxrod.Torque(jaxrod.Impulse(1.0, 5.0, 0.3)))
    sol = jaxrod.simulate(system, system.state(), t1=7.0, solver=jaxrod.BlanesMoan6(), n_steps=20)
    np.testing.assert_allclose(sol.rate[-1], 1 / uniform.moment_of_inertia(), rtol=1e-9)
    with pytest.raises(ValueError, match="pass over a Record or an Impulse"):
        jaxrod.simulate(system, system.state(), t1=7.0, solver=diffrax.Dopri8(), n_steps=20)


def test_a_load_that_is_meant_to_be_zero_in_the_state_is_not_questioned():
    """A spring that is slack at the start, a torque against a rod at rest."""
    system = loaded(jaxrod.Torque(lambda t, state: -0.1 * state.angle), jaxrod.Torque(lambda t, state: -state.rate))
    assert jaxrod.simulate(system, system.state(), t1=0.1).ok


# ---- bases and drives


def _shaken(base):
    system = loaded(base, gravity=9.81)
    return jaxrod.simulate(system, system.state(angle=-math.pi / 2), t1=1.5).angle[-1] + math.pi / 2


RIGHT = -0.11009721645  # SciPy, of the formula


@pytest.mark.slow
def test_base_from_a_record(uniform):
    times = jnp.linspace(0.0, 2.0, 2001)
    along = jaxrod.Record(times, 0.05 * jnp.sin(2 * jnp.pi * times))
    place = jaxrod.Record(times, jnp.stack([along.samples, 0 * times], axis=1))
    acceleration = jaxrod.Record(times, -((2 * jnp.pi) ** 2) * place.samples)
    for base in (
        jaxrod.ShakenBase(lambda t: 0.05 * jnp.stack([jnp.sin(2 * jnp.pi * t), 0.0 * t])),
        jaxrod.ShakenBase(place),
        jaxrod.ShakenBase(lambda t: jnp.stack([along(t), 0.0 * t])),  # found in the closure
        jaxrod.ShakenBase(acceleration=acceleration),
    ):
        assert abs(_shaken(base) - RIGHT) < 1e-9


@pytest.mark.parametrize("method", ["linear", "hold", "trolley"])
def test_base_that_cannot_be_differentiated_is_said(uniform, method):
    times = jnp.linspace(0.0, 2.0, 2001)
    samples = 0.05 * jnp.sin(2 * jnp.pi * times)
    along = {
        "linear": lambda t: jnp.interp(t, times, samples),
        "hold": lambda t: samples[jnp.searchsorted(times, t)],
        "trolley": lambda t: jnp.where(t > 1.0, 0.5 * (t - 1.0), 0.0),
    }[method]
    with pytest.warns(UserWarning, match=r"jaxrod\.Record"):
        _shaken(jaxrod.ShakenBase(lambda t: jnp.stack([along(t), 0.0 * t])))


@pytest.mark.slow
def test_jumps_and_kinks_beside_other_motion_are_said(uniform):
    """What is not accelerated there is so, whatever else moves; a sine of 900 periods is seen."""
    moves = [
        lambda t: jnp.where(t > 1, 0.5 * (t - 1), 0.0) + 0.01 * jnp.sin(3 * t),
        lambda t: 0.1 * jnp.cos(t) + jnp.where(t > 1, 0.1, 0.0),
    ]
    for move in moves:
        with pytest.warns(UserWarning, match="without accelerating it"):
            _shaken(jaxrod.ShakenBase(lambda t, move=move: jnp.stack([move(t), 0.0 * t])))
    jumping = loaded(motion=jaxrod.Driven(lambda t: jnp.where(t > 1, 2 * t**2, t**2)), basis=jaxrod.Ritz(1))
    with pytest.warns(UserWarning, match="without accelerating it"):
        jaxrod.simulate(jumping, jumping.state(), t1=1.5)
    _shaken(jaxrod.ShakenBase(lambda t: jnp.stack([1e-4 * jnp.sin(3770 * t), 0.0 * t])))


class Own(jaxrod.AbstractForce):
    """A moment of one's own, held by a module with a function in it."""

    moment: Any = eqx.field(static=True)

    def power(self, t, state, virtual, body):
        d = state.direction
        return self.moment(t) * (d[0] * virtual.direction[1] - d[1] * virtual.direction[0])

    def check(self, motion):
        pass


@pytest.mark.slow
def test_short_loads_that_read_the_state_are_said():
    """They are zero at each instant, at the start and beside it; what rests at the start alone is not questioned."""
    short = pulse(5.0, 1e-3)
    for force in (
        jaxrod.Torque(lambda t, state: short(t) * jnp.cos(state.angle)),
        jaxrod.TipForce(lambda t, state: short(t) * jnp.stack([-state.direction[1], state.direction[0]])),
        Own(short),
    ):
        system = loaded(force)
        with pytest.warns(UserWarning, match=r"jaxrod\.Impulse"):
            jaxrod.simulate(system, system.state(), t1=10.0)
    brake = jaxrod.Torque(lambda t, state: jnp.where(t > 0.1, -0.1 * state.rate, 0.0))
    growing = jaxrod.TipForce(lambda t, state: -100.0 * t * state.strain)
    system = loaded(brake, growing, basis=jaxrod.Ritz(1))
    assert jaxrod.simulate(system, system.state(), t1=0.3).rate[-1] == 0.0


@pytest.mark.slow
def test_modules_that_hold_functions():
    """A network, a partial, a drive: their functions are no numbers."""

    class Held(eqx.Module):
        shape: Any
        most: jax.Array

        def __call__(self, t, *_):
            return self.most * self.shape(t)

    def end(most, motion=None):
        forces = [] if motion else [jaxrod.Torque(Held(jnp.sin, most))]
        system = loaded(*forces, motion=motion, basis=jaxrod.Ritz(1))
        return jaxrod.simulate(system, system.state(), t1=0.5).tip[-1, 1]

    plain = loaded(jaxrod.Torque(lambda t, state: 2.0 * jnp.sin(t)), basis=jaxrod.Ritz(1))
    right = jaxrod.simulate(plain, plain.state(), t1=0.5).tip[-1, 1]
    np.testing.assert_allclose(end(jnp.asarray(2.0)), right, rtol=1e-12)
    np.testing.assert_allclose(jax.grad(end)(2.0), right / 2, rtol=0.02)  # nearly linear
    assert np.isfinite(end(None, jaxrod.Driven(Held(jnp.sin, jnp.asarray(2.0)))))


def test_trolley_from_a_record():
    """It starts within a sample: the rate jumps by -S v / I."""
    times = jnp.linspace(0.0, 2.5, 2501)
    place = jnp.stack([jnp.where(times > 1.0, 0.5 * (times - 1.0), 0.0), 0 * times], axis=1)
    system = loaded(jaxrod.ShakenBase(jaxrod.Record(times, place)), gravity=9.81)
    sol = jaxrod.simulate(system, system.state(angle=-math.pi / 2), ts=jnp.array([1.01, 2.0]))
    assert abs(sol.rate[0] + 0.75) < 2e-3  # less the swing of 1 cs
    assert abs(sol.angle[1] + math.pi / 2 - 0.12398939) < 5e-4  # of a start at one instant; SciPy


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_uniform_motion_of_base_and_drive_is_not_questioned(dtype):
    base = loaded(jaxrod.ShakenBase(lambda t: jnp.stack([3.0 * t, 1.0 + 0.0 * t])))
    assert jaxrod.simulate(*in_type(dtype, (base, base.state())), t1=1.0).angle[-1] == 0.0
    driven = loaded(motion=jaxrod.Driven(lambda t: 15.7 * t), basis=jaxrod.Ritz(1))
    assert jaxrod.simulate(*in_type(dtype, (driven, driven.state())), t1=0.1).ok


@pytest.mark.slow
def test_drive_from_a_record():
    times = jnp.linspace(0.0, 0.5, 501)
    formula = loaded(motion=jaxrod.Driven(lambda t: 40 * t**2), basis=jaxrod.Ritz(2))
    found = [
        jaxrod.simulate(s, s.state(), t1=0.3).strain[-1]
        for s in (formula, dataclasses.replace(formula, motion=jaxrod.Driven(jaxrod.Record(times, 40 * times**2))))
    ]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
    kinked = loaded(motion=jaxrod.Driven(lambda t: jnp.interp(t, times, 40 * times**2)), basis=jaxrod.Ritz(1))
    with pytest.warns(UserWarning, match=r"jaxrod\.Record"):
        jaxrod.simulate(kinked, kinked.state(), t1=0.3)


# ---- records themselves


def test_a_run_must_not_leave_a_record():
    times = jnp.linspace(0.0, 1.0, 101)
    shaken = loaded(jaxrod.ShakenBase(jaxrod.Record(times, jnp.stack([times**3, 0 * times], axis=1))))
    with pytest.raises(ValueError, match=r"does not reach over the run, from 0 to 1\.5 s"):
        jaxrod.simulate(shaken, shaken.state(), t1=1.5)
    pushed = loaded(jaxrod.Torque(jaxrod.Record(times, 1.0 + times)))
    with pytest.raises(ValueError, match="does not reach over the run"):
        jaxrod.simulate(pushed, pushed.state(), t0=-1.0, t1=0.5)
    codes = jax.vmap(lambda t1: jaxrod.simulate(pushed, pushed.state(), t1=t1).result)(jnp.array([0.5, 1.5]))
    np.testing.assert_array_equal(codes, [jaxrod.Result.ok, jaxrod.Result.invalid])


@pytest.mark.slow
def test_record_is_smooth_and_without_waves_at_jumps():
    def error(samples):
        times = jnp.linspace(0.0, 1.0, samples)
        found = jaxrod.Record(times, jnp.sin(2 * jnp.pi * times))
        x = jnp.linspace(0.0, 1.0, 999)
        second = jax.vmap(jax.grad(jax.grad(lambda t: found(t))))(x)
        return jnp.abs(second + (2 * jnp.pi) ** 2 * jnp.sin(2 * jnp.pi * x)).max()

    assert 2.5 < math.log2(error(101) / error(201)) < 3.6  # order 3 in the second derivative
    for times in (np.linspace(0, 1, 11), np.array([0.0, 0.1, 0.2, 0.3, 0.3 + 1e-6, 0.4, 0.5, 1.0])):
        jump = jaxrod.Record(times, np.where(times > 0.3 + 1e-9, 1.0, 0.0))
        found = jax.vmap(jump)(jnp.linspace(0.0, 1.0, 2001))
        assert found.min() >= -1e-12 and found.max() <= 1 + 1e-12
    assert jaxrod.Record([0.0, 1.0], [2.0, 4.0])(0.5) == 3.0


@pytest.mark.slow
def test_records_are_differentiable():
    times = jnp.linspace(0.0, 1.0, 21)

    def angle(strength, **how):
        system = loaded(jaxrod.Torque(jaxrod.Record(times, strength * jnp.sin(jnp.pi * times) ** 2)))
        return jaxrod.simulate(system, system.state(), t1=1.0, **how).angle[-1]

    # Without gravity the angle is the load's, once more for a load of one.
    np.testing.assert_allclose(jax.grad(angle)(0.3), angle(1.0), rtol=1e-8)
    forward = jax.jacfwd(lambda a: angle(a, adjoint=diffrax.ForwardMode()))(0.3)
    np.testing.assert_allclose(forward, angle(1.0), rtol=1e-8)


@pytest.mark.parametrize(
    ("times", "samples", "sentence"),
    [
        ([0.0], [1.0], "holds one time"),
        ([0.0, 0.0, 1.0], [1.0, 2.0, 3.0], r"must increase, but times\[0\]=0 is followed by 0"),
        ([0.0, 1.0], [1.0, 2.0, 3.0], r"has shape \(3,\) for 2 times"),
        ([0.0, 1.0], [1.0, math.nan], "not finite"),
    ],
)
def test_wrong_records(times, samples, sentence):
    with pytest.raises(ValueError, match=sentence):
        jaxrod.Record(times, samples)


def test_wrong_impulse_and_base():
    with pytest.raises(ValueError, match=r"width=.*must be positive"):
        jaxrod.Impulse(1.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="neither of position= and acceleration="):
        jaxrod.ShakenBase()
