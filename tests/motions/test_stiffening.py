"""Forces that stiffen draw a warning where they are left out; what is said where a rod has no equilibrium."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod

UNIFORM = jaxrod.Uniform(0.025)
SPRING = 1e5 * np.pi * 0.025**2 / 2  # N of the strain, E A / 2 L as a spring between the tip and a wall
SOFT = scene(gravity=9.81, section=UNIFORM, young=4e3)


def held_by(force, motion=None, basis=None):
    return scene(motion, basis or jaxrod.Ritz(2), forces=[force], section=UNIFORM, young=1e5)


SPRUNG = held_by(jaxrod.TipForce(lambda t, state: -SPRING * state.strain))
ASKED = {
    "natural_frequencies": jaxrod.natural_frequencies,
    "frequency_error": jaxrod.frequency_error,
    "critical_rate": jaxrod.critical_rate,
    "continuum.natural_frequencies": lambda system: jaxrod.continuum.natural_frequencies(system, 1),
    "continuum.critical_rate": jaxrod.continuum.critical_rate,
    "continuum.spinning_frequencies": lambda system: jaxrod.continuum.spinning_frequencies(system, 1.0, 1),
    "continuum.steady_spin": lambda system: jaxrod.continuum.steady_spin(system, 1.0),
}


@pytest.mark.parametrize("name", ASKED)
def test_a_spring_is_warned_of(name):
    with pytest.warns(UserWarning, match=f"^{name} leaves out the forces.*jaxrod.modes") as said:
        ASKED[name](SPRUNG)
    assert len(said) == 1 and said[0].filename == __file__


def test_modes_take_the_spring():
    """tan x = -2 x."""
    system = held_by(SPRUNG.forces[0], basis=jaxrod.Ritz(6))
    found = jaxrod.modes(system).frequency[1] * 2 * np.pi / np.sqrt(1e5 / 1200)
    assert float(found) == pytest.approx(1.8365972, abs=1e-7)


SILENT = {
    "constant": jaxrod.TipForce(1.0),
    "in space": jaxrod.TipForce(jnp.array([1.0, 0.0])),
    "of time": jaxrod.TipForce(lambda t, state: jnp.sin(t)),
    "damper": jaxrod.TipForce(lambda t, state: -state.strain_rate),
    "no spring": jaxrod.TipForce(lambda t, state: -0.0 * state.strain),
    "viscosity": jaxrod.KelvinVoigt(1e-4),
    "friction": jaxrod.PivotFriction(0.1),
    "torque": jaxrod.Torque(lambda t, state: state.strain),
}


@pytest.mark.parametrize("name", SILENT)
def test_other_forces_are_not(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jaxrod.natural_frequencies(held_by(SILENT[name]))


def test_nor_is_anything_under_a_transformation():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jax.jit(jaxrod.natural_frequencies)(SPRUNG)


@pytest.mark.parametrize("motion", [jaxrod.Flight(), jaxrod.Spherical(), jaxrod.Driven(lambda t: t)])
def test_in_any_motion_and_of_a_rigid_rung(motion):
    with pytest.warns(UserWarning, match="leaves out the forces"):
        basis = jaxrod.Ritz(1 if isinstance(motion, jaxrod.Driven) else 0)
        jaxrod.continuum.natural_frequencies(held_by(SPRUNG.forces[0], motion, basis), 1)


@pytest.mark.parametrize(
    "given, words",
    [
        ({"angle": np.pi / 2}, r"angle=1.5708. .*strain of -1.47[12], beyond -1"),
        ({"spin": 1.0}, "with spin=1. .*a rod spinning in a vertical plane is never steady"),
        ({"momentum": 1.0}, "with momentum=1. .*never steady"),
    ],
)
def test_no_equilibrium_and_why(given, words):
    """Upright its weight would compress the rod by rho g L / 2 E = 1.4715; the last two balance for a moment, at the bottom."""
    with pytest.raises(ValueError, match=words) as said:
        jaxrod.equilibrium(SOFT, **given)
    assert "critical_rate" not in str(said.value)


def test_a_spin_beyond_the_critical_one():
    with pytest.raises(ValueError, match="the rate of spin exceeds critical_rate"):
        jaxrod.equilibrium(scene(rod=SOFT.rod), spin=30.0)
