"""Time stamps far from zero, derivatives by save times, and events that begin on their level."""

import math

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import jaxrod

ROTATION = jaxrod.Rotation()
EPOCH = 1.7e9  # seconds since 1970, as a logger writes them
NEWTON = optx.Newton(1e-12, 1e-12)

# Name, motion, basis, forces, start, and how it is run.
SCENES = {
    "uniform": (ROTATION, jaxrod.Ritz(1), (), {"rate": 15.0}, {}),
    "rigid": (ROTATION, jaxrod.Ritz(0), (), {"rate": 15.0}, {}),
    "space": (jaxrod.Spherical(), jaxrod.Ritz(1), (), {"rate": 5.0, "azimuth_rate": 3.0}, {}),
    "flight": (jaxrod.Flight(), jaxrod.Ritz(1), (), {"rate": 5.0, "strain": 0.02}, {}),
    "driven": (jaxrod.Driven(lambda t: 15.0 * (t - EPOCH)), jaxrod.Ritz(1), (), {}, {}),
    "several shapes": (ROTATION, jaxrod.Ritz(2), (), {"rate": 15.0}, {}),
    "multistep": (ROTATION, jaxrod.Ritz(1), (), {"rate": 15.0}, {"solver": jaxrod.QuinlanTremaine12(), "n_steps": 300}),
    "adaptive": (ROTATION, jaxrod.Ritz(1), (jaxrod.PivotFriction(0.1),), {"rate": 15.0}, {}),
}


@pytest.mark.parametrize("name", SCENES)
def test_stamps_since_1970(cone, name):
    """An offset changes nothing beyond the stamps' own rounding: here nothing, as both runs have the same."""
    motion, basis, forces, kwargs, how = SCENES[name]
    system = jaxrod.System(cone, motion, basis, gravity=9.81, forces=forces)
    start = system.state(**kwargs)
    stamps = EPOCH + np.array([0.05, 0.2, 0.3])
    late = jaxrod.simulate(system, start, t0=EPOCH, ts=stamps, **how)
    if name == "driven":
        system = jaxrod.System(cone, jaxrod.Driven(lambda t: 15.0 * t), basis, gravity=9.81)
    zero = jaxrod.simulate(system, start, ts=stamps - EPOCH, **how)
    # A drive is evaluated at the stamp: 2e-7 s of rounding, of which its slope takes care.
    atol = 1e-7 if name == "driven" else 1e-13
    np.testing.assert_allclose(late.tip, zero.tip, rtol=0, atol=atol)
    np.testing.assert_array_equal(late.ts, stamps)
    assert late.ok and late.stats["t_end"] == stamps[-1]


def test_right_value(cone):
    system = jaxrod.System(cone, ROTATION, gravity=9.81)
    late = jaxrod.simulate(system, system.state(rate=15.0), t0=EPOCH, ts=EPOCH + np.array([0.05, 0.2, 0.3]))
    assert abs(late.angle[0] - 0.72091411) < 5e-8  # SciPy


def test_log_of_thirty_days_under_vmap(cone):
    clock, system = 2.592e6, jaxrod.System(cone, ROTATION, gravity=9.81)
    stamps = clock + np.array([0.0100, 0.0210, 0.0300, 0.0412])

    def angles(t0, ts):
        return jax.vmap(lambda rate: jaxrod.simulate(system, system.state(rate=rate), t0=t0, ts=ts).angle)(
            jnp.array([10.0, 15.0])
        )

    np.testing.assert_allclose(angles(clock, stamps), angles(0.0, stamps - clock), rtol=0, atol=1e-13)


def test_stamps_in_a_scene_of_float32(cone):
    """The stamps stay in float64, the run in float32."""
    system = jax.tree.map(lambda x: x.astype(jnp.float32), jaxrod.System(cone, ROTATION, gravity=9.81))
    start = jax.tree.map(lambda x: x.astype(jnp.float32), system.state(rate=5.0))
    stamps = EPOCH + np.array([0.05, 0.2, 0.3])
    late, zero = (
        jaxrod.simulate(system, start, **times) for times in ({"t0": EPOCH, "ts": stamps}, {"ts": stamps - EPOCH})
    )
    np.testing.assert_array_equal(late.angle, zero.angle)
    np.testing.assert_array_equal(late.ts, stamps)


def test_events_and_saveat_have_the_users_time(cone):
    system = jaxrod.System(cone, ROTATION, jaxrod.Ritz(0), gravity=9.81)
    event = diffrax.Event(lambda t, y, args, **_: t - (EPOCH + 0.25), NEWTON)
    saveat = diffrax.SaveAt(ts=EPOCH + jnp.array([0.125, 0.5]), t1=True, fn=lambda t, y, args: t)
    sol = jaxrod.simulate(system, system.state(), t0=EPOCH, t1=EPOCH + 1.0, saveat=saveat, event=event)
    np.testing.assert_allclose(sol.states - EPOCH, [0.125, 0.25, np.nan], atol=1e-6)


@pytest.mark.slow
def test_records_on_the_same_clock(uniform):
    times = np.linspace(0.0, 0.5, 129)
    push = np.sin(2 * np.pi * times) ** 2
    found = []
    for clock in (0.0, EPOCH):
        forces = [
            jaxrod.Torque(jaxrod.Record(clock + times, push)),
            jaxrod.Torque(lambda t, s, c=clock: jnp.sin(9 * (t - c))),
        ]
        system = jaxrod.System(uniform, ROTATION, jaxrod.Ritz(0), forces=forces)
        found.append(jaxrod.simulate(system, system.state(), t0=clock, t1=clock + 0.5).angle[-1])
    assert abs(found[1] - found[0]) < 1e-6 * abs(found[0])


# ---- derivatives by save times


def _differences(system, start, **how):
    """Forward and reverse derivatives by a shift of all save times, and the difference quotient."""
    ts, weights = jnp.array([0.011, 0.03, 0.034, 0.06]), np.array([1.0, -2.0, 0.5, 3.0])

    def tip(shift, **more):
        return weights @ jaxrod.simulate(system, start, ts=ts + shift, **how, **more).tip[:, 1]

    h = 1e-6
    forward = jax.jacfwd(lambda shift: tip(shift, adjoint=diffrax.ForwardMode()))(0.004)
    return forward, jax.grad(tip)(0.004), (tip(0.004 + h) - tip(0.004 - h)) / (2 * h)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plain", "viscous", "impulse", "several shapes", "quasi-static"])
def test_derivatives_by_save_times(cone, name):
    basis, forces = {
        "plain": (jaxrod.Ritz(1), ()),
        "viscous": (jaxrod.Ritz(1), (jaxrod.KelvinVoigt(1e-4),)),
        "impulse": (jaxrod.Ritz(1), (jaxrod.Torque(jaxrod.Impulse(1.0, 0.02, 0.005)),)),
        "several shapes": (jaxrod.Ritz(2), ()),
        "quasi-static": (jaxrod.QuasiStatic(jaxrod.Ritz(1)), ()),
    }[name]
    system = jaxrod.System(cone, ROTATION, basis, gravity=9.81, forces=forces)
    forward, reverse, difference = _differences(system, system.state(rate=5.0, strain=0.03))
    np.testing.assert_allclose([forward, reverse], difference, rtol=1e-6)


# ---- derivatives of derivatives


def _end(uniform, *forces):
    system = jaxrod.System(uniform, ROTATION, jaxrod.Ritz(0), gravity=9.81, forces=forces)
    return lambda rate, **how: jaxrod.simulate(system, system.state(rate=rate), t1=0.2, **how).angle[-1]


def test_second_derivatives(uniform):
    end = _end(uniform)
    difference = (end(5.001) - 2 * end(5.0) + end(4.999)) / 1e-6
    np.testing.assert_allclose(jax.hessian(end)(5.0), difference, rtol=1e-4)
    with pytest.raises(ValueError, match=r"jax\.jacfwd\(jax\.grad\(f\)\)"):
        jax.grad(jax.grad(end))(5.0)
    with pytest.raises(ValueError, match=r"adjoint=diffrax\.ForwardMode\(\)"):
        jax.jacfwd(end)(5.0)


@pytest.mark.slow
def test_second_derivatives_with_friction(uniform):
    end = _end(uniform, jaxrod.PivotFriction(0.2))
    difference = (end(5.001) - 2 * end(5.0) + end(4.999)) / 1e-6
    twice = jax.jacfwd(jax.jacfwd(lambda rate: end(rate, adjoint=diffrax.ForwardMode())))(5.0)
    np.testing.assert_allclose(twice, difference, rtol=1e-4)
    for nested in (jax.hessian(end), jax.grad(jax.grad(end))):
        with pytest.raises(ValueError, match=r"adjoint=diffrax\.ForwardMode\(\)|jax\.jacfwd\(jax\.grad\(f\)\)"):
            nested(5.0)


# ---- events


def _pendulum(uniform):
    return jaxrod.System(uniform, ROTATION, jaxrod.Ritz(0), gravity=9.81)


def test_event_that_begins_on_its_level(uniform):
    system, level = _pendulum(uniform), diffrax.Event(lambda t, y, args, **_: y.direction[1], NEWTON)
    for angle, right in ((0.0, 0.27318487), (1e-12, 0.27318487), (-1e-13, 0.27318487)):
        sol = jaxrod.simulate(system, system.state(angle=angle, rate=2.0), t1=5.0, event=level)
        assert sol.ok and abs(sol.ts[0] - right) < 1e-7 and sol.event == 0


def test_event_that_begins_at_rest(uniform):
    """The rate is zero at the start: the run ends when it is so again, at the other end of the swing."""
    system, turning = _pendulum(uniform), diffrax.Event(lambda t, y, args, **_: y.rate, NEWTON)
    sol = jaxrod.simulate(system, system.state(angle=-1.0), t1=5.0, event=turning)
    assert sol.event == 0 and abs(sol.angle[0] - (1.0 - math.pi)) < 1e-7


def test_which_event_ended_a_run(uniform):
    system = _pendulum(uniform)
    conditions = [lambda t, y, args, **_: y.direction[1] - 0.5, lambda t, y, args, **_: t - 1.0]
    for rate, which in ((10.0, 0), (1.0, 1)):
        event = diffrax.Event(conditions, NEWTON)
        sol = jaxrod.simulate(system, system.state(angle=-math.pi / 2, rate=rate), t1=5.0, event=event)
        assert sol.event == which and f"condition {which} of event= ended it" in str(sol)
    sol = jaxrod.simulate(system, system.state(), t1=0.1, event=diffrax.Event(conditions[1], NEWTON))
    assert sol.event == -1 and "reached its end" in str(sol)
    assert jaxrod.simulate(system, system.state(), t1=0.1).event is None
