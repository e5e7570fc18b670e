"""Second derivatives of equilibria, modes, rungs and exact frequencies: in any nesting, against closed forms and differences."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod

UNIFORM = jaxrod.Uniform(0.025)
uniform = functools.partial(scene, section=UNIFORM)
NESTED = {
    "forward over forward": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "forward over reverse": lambda f: jax.jacfwd(jax.jacrev(f)),
    "reverse over reverse": lambda f: jax.jacrev(jax.jacrev(f)),
}
SOME = ["forward over reverse"]  # of equilibria: each nesting takes long to compile, and test_sag has all of them
nested = pytest.mark.parametrize("second", NESTED.values(), ids=NESTED.keys())


def check(f, x, h, rtol=1e-6, nestings=NESTED):
    """Against central differences of the first derivative, itself one of the values."""
    first = jax.jit(jax.jacfwd(f))
    np.testing.assert_allclose(first(x), (f(x + h) - f(x - h)) / (2 * h), rtol=rtol, atol=1e-9)
    expected = (first(x + h) - first(x - h)) / (2 * h)
    for name in nestings:
        found = jax.jit(NESTED[name](f))(x)
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max(), err_msg=name)


@pytest.mark.slow
@nested
def test_sag(second):
    """rho g L / 2 E."""

    def sag(young):
        return jaxrod.equilibrium(uniform(gravity=9.81, young=young)).strain

    strain = 1200 * 9.81 / 2e5
    assert float(second(sag)(1e5)) == pytest.approx(2 * strain / 1e10, rel=1e-9)
    assert float(second(lambda E: sag(E) ** 2)(1e5)) == pytest.approx(6 * strain**2 / 1e10, rel=1e-9)


@pytest.mark.slow
def test_third_derivative_of_the_sag():
    third = jax.jacfwd(jax.jacfwd(jax.jacrev(lambda E: jaxrod.equilibrium(uniform(gravity=9.81, young=E)).strain)))
    assert float(third(1e5)) == pytest.approx(-6 * 1200 * 9.81 / 2e5 / 1e15, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("second", [NESTED["forward over reverse"]])
def test_sag_of_another_law(second):
    def sag(x):
        system = uniform(gravity=9.81 * x[1], young=1e5 * x[0], law=jaxrod.law.neo_hookean)
        return jaxrod.equilibrium(system).strain

    found = second(sag)(jnp.ones(2)) / np.array([[1e10, 9.81e5], [9.81e5, 9.81**2]])
    np.testing.assert_allclose(found, [[1.40123e-11, -7.53604e-08], [-7.53604e-08, 8.03680e-05]], rtol=1e-5)


@pytest.mark.slow
def test_an_equilibrium_under_a_force_whose_strength_hides_in_a_function():
    """c strain^2 at the tip, beside the stiffness E A: E A e = rho g A L / 2 + c e^2 by the tension at the middle."""

    def strain(c):
        force = jaxrod.TipForce(lambda t, state: c * state.strain**2)
        return jaxrod.equilibrium(uniform(gravity=9.81, forces=[force], young=1e5)).strain

    check(strain, 100.0, 1.0, nestings=SOME)


SPUN = {
    "rate": lambda x: jaxrod.equilibrium(uniform(young=1e5 * x), spin=3.0 * x).strain,
    "momentum": lambda x: jaxrod.equilibrium(uniform(young=1e5), momentum=2.0 * x).strain,
    "in flight": lambda x: (
        jaxrod.equilibrium(uniform(jaxrod.Flight(), jaxrod.Ritz(2), young=1e5 * x), spin=3.0 * x).strain
    ),
    "driven": lambda x: jaxrod.equilibrium(uniform(jaxrod.Driven(lambda t: 3.0 * t), young=1e5 * x)).strain,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SPUN)
def test_spinning_equilibria(name):
    check(SPUN[name], 1.0, 1e-4, nestings=SOME)


def spring(x):
    return jaxrod.TipForce(lambda t, state: -20.0 * x**2 * state.strain)


def forced(x, motion=None, **given):
    """Angle and strain of a rod with a spring along it."""
    motion = motion or jaxrod.Spherical()
    gravity = 9.81 if isinstance(motion, jaxrod.Spherical) else None
    state = jaxrod.equilibrium(uniform(motion, gravity=gravity, forces=[spring(x)], young=1e5), **given)
    return jnp.stack([state.angle, state.strain])


@pytest.mark.slow
def test_an_equilibrium_in_space_under_a_force():
    check(lambda x: forced(x, spin=6.0 * x), 1.0, 1e-4, nestings=["forward over reverse"])


@pytest.mark.slow
@pytest.mark.parametrize("second", [NESTED["forward over forward"], NESTED["reverse over reverse"]])
def test_frequency_of_the_swing(second):
    """sqrt(1.5 g / (1 + rho g L / 2 E)) / 2 pi."""

    def swing(young):
        return jaxrod.modes(uniform(gravity=9.81, young=young)).frequency[0]

    def exact(young):
        return jnp.sqrt(1.5 * 9.81 / (1 + 1200 * 9.81 / (2 * young))) / (2 * jnp.pi)

    assert float(second(swing)(1e5)) == pytest.approx(float(second(exact)(1e5)), rel=1e-8)


# ---- frequencies

TABLE = jaxrod.Table([0.0, 0.3, 0.55, 1.0], radii=[0.02, 0.03, 0.02, 0.01])
HELD = {
    "root": jaxrod.Rotation(),
    "inside": jaxrod.Rotation(0.35),
    "middle": jaxrod.Rotation(0.5),
    "free": jaxrod.Flight(),
}


@nested
@pytest.mark.parametrize("section", [UNIFORM, jaxrod.Cone(0.02, 0.03), TABLE], ids=["uniform", "cone", "table"])
@pytest.mark.parametrize("held", HELD)
def test_exact_frequencies_by_the_modulus(second, section, held):
    """As the root of it."""

    def frequencies(young):
        tip_mass = 0.4 if held == "inside" else None
        return jaxrod.continuum.natural_frequencies(
            scene(HELD[held], section=section, young=young, tip_mass=tip_mass), 2
        )

    np.testing.assert_allclose(jax.jit(second(frequencies))(1e7) * 4e14 / frequencies(1e7), -1.0, rtol=1e-8)


EXACT = {
    "pivot": lambda x: jaxrod.continuum.natural_frequencies(uniform(jaxrod.Rotation(0.3 * x)), 2),
    "length": lambda x: jaxrod.continuum.natural_frequencies(
        scene(jaxrod.Rotation(0.3), length=1.2 * x, section=TABLE_LONG, tip_mass=0.1), 2
    ),
    "critical": lambda x: jaxrod.continuum.critical_rate(uniform(jaxrod.Rotation(0.3 * x), young=1e7 * x)),
    "spinning": lambda x: jaxrod.continuum.spinning_frequencies(uniform(young=1e5), 5.0 * x, 2),
    "spinning freely": lambda x: jaxrod.continuum.spinning_frequencies(
        uniform(young=1e5 * x), 5.0 * x**2, 2, free=True
    ),
    "steady": lambda x: jaxrod.continuum.steady_spin(uniform(young=1e5 * x), 5.0 * x**2),
    "quick rungs": lambda x: jaxrod.natural_frequencies(
        uniform(jaxrod.Rotation(0.3 * x), jaxrod.Ritz(2), young=1e7 * x)
    ),
    "rungs": lambda x: jaxrod.natural_frequencies(uniform(jaxrod.Rotation(0.3 * x), jaxrod.Ritz(4))),
    "rung's critical": lambda x: jaxrod.critical_rate(uniform(jaxrod.Rotation(0.3 * x), jaxrod.Ritz(3), young=1e7 * x)),
    "bending": lambda x: jaxrod.model_limits(uniform(jaxrod.Rotation(0.3 * x))).bending_frequencies,
    "lateral": lambda x: jaxrod.model_limits(uniform(jaxrod.Rotation(0.3 * x))).lateral_inertia,
}
TABLE_LONG = jaxrod.Table([0.0, 0.6, 2.0], radii=[0.02, 0.03, 0.01])


LONG = ("length", "rungs", "rung's critical")


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in EXACT])
def test_frequencies_by_what_moves_them(name):
    check(EXACT[name], 1.0, 1e-4, rtol=1e-5)
