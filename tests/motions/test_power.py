"""Energy grows at the rate at which forces and drive do work, dE/dt = P, at any state of any scene.

Not along runs but at single states: the change of `system.energy` with t, q and v along the motion is summed and held
against `system.power`, by the sizes of its terms.  Every program carries every force and the body at the tip, and
Hypothesis draws all numbers, each of them zero now and then.  The fast set has every motion with every law, every law
with every rung, and every rung; of the complete product every motion on every rung is slow.

Where the strain is condensed, E(q, v, a) with the static a(t, q, v) and no strain rate: by dL/da + Q_a = 0 the work of
the forces is Q v + Q_a a', with a' the rate at which the static strain follows.  So the power is that of a state which
has this rate, for all forces that do not ask for it (Kelvin and Voigt's does, and rests).
"""

import dataclasses
import functools
import itertools

import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod

MOTIONS = ("rotation", "rotation about a pivot", "spherical", "flight", "driven")
BASES = {
    "rigid": jaxrod.Ritz(0),
    "Ritz(1)": jaxrod.Ritz(1),
    "Ritz(2)": jaxrod.Ritz(2),
    "Ritz(4)": jaxrod.Ritz(4),
    "ForceRitz(2)": jaxrod.ForceRitz(2),
    "QuasiStatic": jaxrod.QuasiStatic(jaxrod.Ritz(2)),
}
LAWS = ("hooke", "green", "neo_hookean")
LOADS = ("free", "loaded")

COVERING = [
    ("rotation", "QuasiStatic", "hooke"),
    ("rotation", "Ritz(1)", "green"),
    ("rotation", "ForceRitz(2)", "neo_hookean"),
    ("rotation about a pivot", "Ritz(4)", "hooke"),
    ("rotation about a pivot", "ForceRitz(2)", "green"),
    ("rotation about a pivot", "Ritz(1)", "neo_hookean"),
    ("spherical", "rigid", "hooke"),
    ("spherical", "ForceRitz(2)", "hooke"),
    ("spherical", "Ritz(2)", "green"),
    ("spherical", "Ritz(4)", "neo_hookean"),
    ("flight", "Ritz(1)", "hooke"),
    ("flight", "Ritz(4)", "green"),
    ("flight", "Ritz(2)", "neo_hookean"),
    ("driven", "Ritz(2)", "hooke"),
    ("driven", "Ritz(4)", "green"),
    ("driven", "Ritz(1)", "neo_hookean"),
]


def numbers(n):
    """Strategy for all numbers of a scene, its load and its state."""

    def within(low, high=None):
        return st.floats(-low if high is None else low, low if high is None else high)

    def several(size, bound):
        return st.lists(within(bound), min_size=size, max_size=size).map(np.array)

    return st.fixed_dictionaries({
        "root_radius": within(0.015, 0.03), "tip_radius": within(0.015, 0.03), "young": within(1e6, 1e8),
        "tip_mass": within(0.0, 1.0), "tip_inertia": within(0.0, 0.05), "pivot": within(0.05, 0.95),
        "drive": several(3, 10.0), "gravity": within(0.0, 20.0), "gravity_vector": several(3, 20.0),
        "torque": several(3, 50.0), "torque_growth": within(20.0), "torque_rate": within(5.0),
        "pull": within(100.0), "tip_force": several(3, 100.0), "friction": within(0.0, 5.0), "viscosity": within(0.0, 1e-2),
        "shake": several(3, 0.05),
        "t": within(2.0), "angle": within(1.2), "rate": within(30.0), "azimuth": within(3.0), "azimuth_rate": within(30.0),
        "amplitudes": several(n, 0.15), "amplitude_rates": several(n, 15.0), "center": several(2, 5.0),
        "center_velocity": several(2, 20.0),
    })  # fmt: skip


def forces(motion, basis, x):
    """All forces that the motion can have."""
    space, flight, wave = motion.dimension == 3, isinstance(motion, jaxrod.Flight), motion.dimension - 1

    def torque(t, state):
        growing = x["torque"][: 3 if space else 1] * (1 + t) + x["torque_growth"] * jnp.sin(3 * t)
        turning = jnp.cross(state.direction, state.direction_rate) if space else state.rate
        return growing - x["torque_rate"] * turning if space else growing[0] - x["torque_rate"] * turning

    def shaken(t):
        return x["shake"][: motion.dimension] * jnp.cos(20 * t + jnp.arange(wave + 1.0))

    given = [
        jaxrod.Torque(x["torque"] if space else x["torque"][1]),
        jaxrod.Torque(torque),
        jaxrod.TipForce(x["pull"]),
        jaxrod.TipForce(lambda t, state: x["tip_force"][: motion.dimension] * (jnp.cos(t) + state.direction[0])),
    ]
    if basis.n and not isinstance(basis, jaxrod.QuasiStatic):  # else it does nothing
        given.append(jaxrod.KelvinVoigt(x["viscosity"]))
    if not flight:
        given += [jaxrod.PivotFriction(x["friction"]), jaxrod.ShakenBase(shaken)]
    return given


def drawn(kind, basis, law, load, x):
    section = jaxrod.Cone(x["root_radius"], x["tip_radius"])
    motion = {
        "rotation": jaxrod.Rotation,
        "rotation about a pivot": lambda: jaxrod.Rotation(x["pivot"]),
        "spherical": jaxrod.Spherical,
        "flight": jaxrod.Flight,
        "driven": lambda: jaxrod.Driven(lambda t: x["drive"] @ jnp.stack([t, t**2, jnp.sin(2 * t)])),
    }[kind]()
    tip, gravity, given = {}, None, ()
    if load == "loaded":
        tip = {"tip_mass": x["tip_mass"], "tip_inertia": x["tip_inertia"]}
        # A number and a vector in turn: laws other than Hooke's take the vector.
        gravity = x["gravity"] if law == "hooke" else x["gravity_vector"][: motion.dimension]
        given = forces(motion, basis, x)
    rod = {"section": section, "young": x["young"], "law": getattr(jaxrod.law, law), **tip}
    return scene(motion, basis, gravity, given, **rod)


def start(system, x):
    keywords = {"amplitudes": x["amplitudes"], "amplitude_rates": x["amplitude_rates"]}
    if not isinstance(system.motion, jaxrod.Driven):
        keywords |= {"angle": x["angle"], "rate": x["rate"]}
    if system.motion.dimension == 3:
        keywords |= {"azimuth": x["azimuth"], "azimuth_rate": x["azimuth_rate"]}
    if isinstance(system.motion, jaxrod.Flight):
        keywords |= {"center": x["center"], "center_velocity": x["center_velocity"]}
    return system.state(**keywords)


@functools.cache
def balance(kind, basis, law, load):
    """Compiled: the terms of dE/dt, the power, and a natural energy times the rates, for where no term is left."""

    def terms(x):
        system, t = drawn(kind, BASES[basis], law, load, x), x["t"]
        equations = system.equations(jaxrod.default_chart(system))
        q, v = equations.encode(t, start(system, x))
        acceleration = equations.acceleration(t, q, v)
        by_t, by_q, by_v = jax.grad(lambda *at: system.energy(equations.decode(*at)), (0, 1, 2))(t, q, v)
        along = (t, q, v), (jnp.ones_like(t), v, acceleration)
        state, growth = jax.jvp(equations.decode, *along)
        state = dataclasses.replace(state, amplitude_rates=growth.amplitudes)
        # int E A ds too: strains that are kept as 1 + strain have an absolute error of one rounding.
        turning = (system.kinetic_energy(state) + system.rod.stiffness) * jnp.linalg.norm(state.direction_rate)
        turning = turning + 1e-3 * system.rod.stiffness * jnp.linalg.norm(state.amplitude_rates)  # a few roundings
        return jnp.concatenate([by_t[None], by_q * v, by_v * acceleration]), system.power(t, state), turning

    return jax.jit(terms)


def check(kind, basis, law, load):
    @hypothesis.settings(derandomize=True, deadline=None, max_examples=40, database=None)
    @hypothesis.given(numbers(BASES[basis].n))
    def balanced(x):
        terms, power, turning = jax.tree.map(np.asarray, balance(kind, basis, law, load)(x))
        size = np.sum(np.abs(terms)) + np.abs(power) + turning
        assert np.isfinite(size), "a state that makes sense"
        underflow = 1e-200  # W: products on the way to a smaller power may be denormal
        assert np.abs(np.sum(terms) - power) <= 1e-12 * size + underflow, f"dE/dt = {np.sum(terms)} W, power {power} W"

    balanced()


_FAST = COVERING[1::2]  # every second one; the others with the slow tests


@pytest.mark.parametrize(
    "kind, basis, law", [pytest.param(*x, marks=() if x in _FAST else pytest.mark.slow) for x in COVERING]
)
def test_energy_grows_by_the_power(kind, basis, law):
    check(kind, basis, law, "loaded")


def test_the_covering_set_covers():
    assert {(kind, law) for kind, _, law in COVERING} == {(kind, law) for kind in MOTIONS for law in LAWS}
    assert {basis for _, basis, _ in COVERING} == set(BASES)
    elastic = set(BASES) - {"rigid", "QuasiStatic"}
    assert {(basis, law) for _, basis, law in COVERING} >= {(basis, law) for basis in elastic for law in LAWS}


def everything():
    """The complete product, without what there is not: a rigid rod has no law, `QuasiStatic` Hooke's and no drive."""
    for kind, basis, law, load in itertools.product(MOTIONS, BASES, LAWS, LOADS):
        linear_only = basis in ("rigid", "QuasiStatic") and law != "hooke"
        if load == "free" and law != "hooke":
            continue  # what the loads add is tested; the law alone is in test_laws
        if not linear_only and not (kind == "driven" and basis == "QuasiStatic"):
            yield kind, basis, law, load


def one_of_each():
    """Every motion on every rung, by one law and load after another."""
    for k, (_, scenes) in enumerate(itertools.groupby(everything(), lambda x: x[:2])):
        scenes = list(scenes)
        yield scenes[k % len(scenes)]


_SAMPLED = list(one_of_each())


def test_the_sample_meets_everything():
    for k in range(4):
        assert {x[k] for x in _SAMPLED} == {x[k] for x in everything()}


@pytest.mark.slow
@pytest.mark.parametrize("kind, basis, law, load", _SAMPLED)
def test_energy_grows_by_the_power_in_more_scenes(kind, basis, law, load):
    check(kind, basis, law, load)
