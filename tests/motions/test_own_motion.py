"""A motion of one's own, in one file: a rod that turns in an inclined plane, which the library does not have."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod

RATES = jnp.array([2.0, 3.0, 4.0])


class Inclined(jaxrod.AbstractMotion):
    """Turning about an axis through the root that leans by `slope` rad: gravity pulls with cos(slope) of itself."""

    slope: Any
    pivot: Any = None
    dimension: ClassVar[int] = 2

    def pull(self, gravity):
        return jnp.cos(self.slope) * super().pull(gravity)


def tip(cone, rate, slope=0.0, basis=None, **how):
    system = jaxrod.System(cone, Inclined(jnp.asarray(slope)), basis, gravity=9.81)
    return jaxrod.simulate(system, system.state(rate=rate), t1=0.5, **how).tip[-1]


@pytest.mark.parametrize("basis", [jaxrod.Ritz(0), jaxrod.Ritz(1), jaxrod.LoadRitz(2)], ids=str)
def test_turns_in_less_gravity(cone, basis):
    for slope in (0.0, 0.7):
        system = jaxrod.System(cone, jaxrod.Rotation(), basis, gravity=9.81 * np.cos(slope))
        alike = jaxrod.simulate(system, system.state(rate=3.0), t1=0.5)
        np.testing.assert_allclose(tip(cone, 3.0, slope, basis), alike.tip[-1], rtol=1e-12)
        np.testing.assert_allclose(
            tip(cone, 3.0, slope, basis, chart=jaxrod.Angles()), alike.tip[-1], rtol=1e-7, atol=1e-9
        )


def test_keeps_its_energy(cone):
    system = jaxrod.System(cone, Inclined(jnp.asarray(0.7)), gravity=9.81)
    sol = jaxrod.simulate(system, system.state(rate=3.0), ts=jnp.linspace(0.0, 0.5, 6)[1:])
    assert sol.ledger.energy < 1e-9
    np.testing.assert_allclose(jaxrod.equilibrium(system).angle, -np.pi / 2)


def test_hangs_where_its_gravity_pulls(cone):
    """Also where it is turned, and not only less."""

    class Sideways(Inclined):
        def pull(self, gravity):
            return jnp.stack([gravity, jnp.zeros_like(gravity)])

    system = jaxrod.System(cone, Sideways(jnp.asarray(0.0)), gravity=9.81)
    rest = jaxrod.equilibrium(system)
    np.testing.assert_allclose(rest.angle, 0.0, atol=1e-12)
    hanging = jaxrod.equilibrium(jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81))
    np.testing.assert_allclose(rest.strain, hanging.strain, rtol=1e-12)


class Cranked(jaxrod.AbstractMotion):
    """Driven to and fro, by formulas of its own."""

    swing: Any
    pivot: Any = None
    dimension: ClassVar[int] = 2
    prescribed: ClassVar[bool] = True

    def turning(self, t):
        return self.swing * jnp.sin(3 * t), 3 * self.swing * jnp.cos(3 * t), -9 * self.swing * jnp.sin(3 * t)


@pytest.mark.parametrize("t0", [0.0, 0.4])
def test_is_driven_on_the_clock_of_the_run(cone, t0):
    own, driven = (
        jaxrod.System(cone, motion, gravity=9.81)
        for motion in (Cranked(jnp.asarray(0.5)), jaxrod.Driven(lambda t: 0.5 * jnp.sin(3 * t)))
    )
    ends = [jaxrod.simulate(x, x.state(), t0=t0, t1=t0 + 0.3).tip[-1] for x in (own, driven)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-10)


def test_differentiates_by_what_is_its_own(cone):
    def end(slope):
        return tip(cone, 3.0, slope)[0]

    difference = (end(0.7 + 1e-5) - end(0.7 - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.grad(end)(0.7), difference, rtol=1e-6)


def test_in_a_sweep(cone):
    many = jaxrod.sweep(lambda rate: tip(cone, rate, 0.7), RATES)
    np.testing.assert_allclose(many, [tip(cone, rate, 0.7) for rate in RATES], rtol=1e-10)
