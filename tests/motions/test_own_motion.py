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


@pytest.fixture
def rod():
    return jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), 1e7, 1200.0)


def tip(rod, rate, slope=0.0, basis=None, **how):
    system = jaxrod.System(rod, Inclined(jnp.asarray(slope)), basis, gravity=9.81)
    return jaxrod.simulate(system, system.state(rate=rate), t1=0.5, **how).tip[-1]


@pytest.mark.parametrize("basis", [jaxrod.Ritz(0), jaxrod.Ritz(1), jaxrod.LoadRitz(2)], ids=str)
def test_turns_in_less_gravity(rod, basis):
    for slope in (0.0, 0.7):
        system = jaxrod.System(rod, jaxrod.Rotation(), basis, gravity=9.81 * np.cos(slope))
        alike = jaxrod.simulate(system, system.state(rate=3.0), t1=0.5)
        np.testing.assert_allclose(tip(rod, 3.0, slope, basis), alike.tip[-1], rtol=1e-12)
        np.testing.assert_allclose(
            tip(rod, 3.0, slope, basis, chart=jaxrod.Angles()), alike.tip[-1], rtol=1e-7, atol=1e-9
        )


def test_keeps_its_energy(rod):
    system = jaxrod.System(rod, Inclined(jnp.asarray(0.7)), gravity=9.81)
    sol = jaxrod.simulate(system, system.state(rate=3.0), ts=jnp.linspace(0.0, 0.5, 6)[1:])
    assert sol.ledger.energy < 1e-9
    np.testing.assert_allclose(jaxrod.equilibrium(system).angle, -np.pi / 2)


def test_differentiates_by_what_is_its_own(rod):
    def end(slope):
        return tip(rod, 3.0, slope)[0]

    difference = (end(0.7 + 1e-5) - end(0.7 - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.grad(end)(0.7), difference, rtol=1e-6)


def test_in_a_sweep(rod):
    many = jaxrod.sweep(lambda rate: tip(rod, rate, 0.7), RATES)
    np.testing.assert_allclose(many, [tip(rod, rate, 0.7) for rate in RATES], rtol=1e-10)
