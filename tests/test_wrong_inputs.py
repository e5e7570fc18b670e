# ruff: noqa: E501 (a row a line)
"""Whatever a public name is given wrongly, it answers with one sentence: argument, value, remedy.

Each row of the tables is an id, a call, and what its one sentence must say.
"""

import dataclasses
import functools
import math
import re
import warnings
from typing import ClassVar

import conftest
import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxrod
from jaxrod.rods.section import AbstractSection

REMEDY = re.compile(
    r"\b(give|take|leave|call|make|map|must|ask|start|move|drop|raise|plan|measure|pass|sort|settle|compare)\b"
)
INTERNAL = re.compile(r"Tracer|[Jj]axpr|dtype <|jaxlib|0x[0-9a-f]{6}|ShapeDtypeStruct|ShapedArray|\bvmap of\b")
TS = np.linspace(0.01, 0.05, 5)


# ---- what calls are made on, made once


rod = functools.partial(conftest.make_rod, section=jaxrod.Uniform(0.025))
made = functools.partial(conftest.scene, rod=rod())


@functools.cache
def body():
    return jaxrod.Lumped(inertia=1.0, first_moment=1.0, stiffness=1.0, length=1.0)


@functools.cache
def scene():
    return made()


@functools.cache
def rigid():
    return made(basis=jaxrod.Ritz(0))


@functools.cache
def start():
    return scene().state(rate=1.0)


@functools.cache
def space():
    return made(jaxrod.Spherical())


@functools.cache
def flight():
    return made(jaxrod.Flight())


@functools.cache
def sol():
    return jaxrod.simulate(rigid(), rigid().state(rate=1.0), ts=TS, n_steps=5)


@functools.cache
def own():
    return jaxrod.simulate(pendulum(), (np.ones(1), np.zeros(1)), t1=0.1)


@functools.cache
def pendulum():
    return jaxrod.Lagrangian(lambda t, q, v: v @ v / 2 + jnp.cos(q[0]))


def many():
    """Five states at once."""
    return jax.tree.map(lambda x: jnp.stack([x] * 5), start())


def run(system=None, first=None, **keywords):
    system = scene() if system is None else system
    keywords = keywords if {"t1", "ts"} & set(keywords) else {"t1": 0.1} | keywords
    return jaxrod.simulate(
        system, (start() if system is scene() else system.state()) if first is None else first, **keywords
    )


def quick(**keywords):
    """A run that is compiled already."""
    return jaxrod.simulate(rigid(), rigid().state(rate=1.0), ts=TS, n_steps=5, **keywords)


def fitted(model=lambda p: jnp.stack([p["a"], p["a"]]), data=(1.0, 1.0), sigma=0.1, start=None, **keywords):
    return jaxrod.fit(model, data, sigma, {"a": 2.0} if start is None else start, **keywords)


class Power(jaxrod.AbstractForce):
    """A force of one's own, its power a function of the virtual velocity."""

    function: object

    def power(self, t, state, virtual, body):
        return self.function(virtual)

    def check(self, motion):
        pass


class Plate(AbstractSection):
    """A section of one's own."""

    function: object
    breaks: ClassVar = ()

    def area(self, s, length):
        return self.function(s)


# ---- functions that a user gives, and what goes wrong in them


def _first(given):
    return jnp.sum(jnp.asarray(jax.tree.leaves(given)[0]))


FAULTS = {
    "raises": (lambda *given, **_: 1 / 0, "raised ZeroDivisionError: division by zero"),
    "none": (lambda *given, **_: None, "returned None"),
    "text": (lambda *given, **_: "a", "returned 'a'"),
    "dict": (lambda *given, **_: {"a": _first(given)}, r"returned (dict|an array|\{)"),
    "object": (lambda *given, **_: object(), r"returned object\(\.\.\.\)"),
    "numpy": (lambda *given, **_: np.interp(_first(given), [0, 1], [0, 1]), "numpy, math, float"),
    "math": (lambda *given, **_: math.sin(_first(given)), "numpy, math, float"),
    "if": (lambda *given, **_: 1.0 if _first(given) > 1 else 2.0, "numpy, math, float"),
    "float": (lambda *given, **_: float(_first(given)), "numpy, math, float"),
    "complex": (lambda *given, **_: 1j * _first(given), "returned complex numbers"),
    "shape": (lambda *given, **_: jnp.ones((7, 7)) * _first(given), r"returned an array of shape \(7, 7\)"),
    "attribute": (lambda *given, **_: given[-1].angel, "raised AttributeError: .*angel"),
    "no arguments": (lambda: 1.0, "raised TypeError: .*(0 positional arguments|unexpected keyword)"),
    "too many arguments": (lambda a, b, c, d, e, f: 1.0, "raised TypeError: .*(missing|unexpected keyword)"),
}
TAKERS = {
    "section": (lambda f: rod(section=f), "^section= "),
    "Profile": (lambda f: rod(section=jaxrod.Profile(f)), "^section= "),
    "own section": (lambda f: rod(section=Plate(f)), "^section= "),
    "young": (lambda f: rod(young=f), "^young= "),
    "density": (lambda f: rod(density=f), "^density= "),
    "law": (lambda f: rod(law=f), "^law="),
    "Torque": (lambda f: made(forces=(jaxrod.Torque(f),)), r"^Torque\(moment=\) "),
    "Torque in space": (lambda f: made(jaxrod.Spherical(), forces=(jaxrod.Torque(f),)), r"^Torque\(moment=\) "),
    "TipForce": (lambda f: made(forces=(jaxrod.TipForce(f),)), r"^TipForce\(force=\) "),
    "PivotFriction": (lambda f: made(forces=(jaxrod.PivotFriction(f),)), r"^PivotFriction\(coefficient=\) "),
    "KelvinVoigt": (lambda f: made(forces=(jaxrod.KelvinVoigt(f),)), r"^KelvinVoigt\(time=\) "),
    "ShakenBase": (lambda f: made(forces=(jaxrod.ShakenBase(f),)), r"^ShakenBase\(position=\) "),
    "ShakenBase, acceleration": (
        lambda f: made(forces=(jaxrod.ShakenBase(acceleration=f),)),
        r"^ShakenBase\(acceleration=\) ",
    ),
    "own force": (lambda f: made(forces=(Power(f),)), r"^Power\.power "),
    "Driven": (lambda f: jaxrod.Driven(f), r"^Driven\(angle=\) "),
    "Lagrangian": (lambda f: run(jaxrod.Lagrangian(f), (np.ones(2), np.ones(2))), r"^Lagrangian\(function=\) "),
    "Lagrangian, force": (
        lambda f: run(jaxrod.Lagrangian(pendulum().function, force=f), (np.ones(2), np.ones(2))),
        r"^Lagrangian\(force=\) ",
    ),
    "Lagrangian, solve": (
        lambda f: jaxrod.Lagrangian(pendulum().function, solve=f).acceleration(0.0, jnp.ones(2), jnp.ones(2)),
        r"^Lagrangian\(solve=\) ",
    ),
    "event": (lambda f: run(event=diffrax.Event(f)), "^event "),
    "saveat": (lambda f: run(saveat=diffrax.SaveAt(t1=True, fn=f)), r"^saveat\.fn "),
    "budget": (lambda f: quick(budget=f), "^quantity "),
    "CustomQuantity": (lambda f: jaxrod.CustomQuantity(f, name="peak")(sol()), "^peak "),
    "sweep": (lambda f: jaxrod.sweep(f, jnp.ones(3)), "^fn "),
    "order_by": (lambda f: jaxrod.sweep(lambda x: x, jnp.ones(3), order_by=f), "^order_by "),
    "model": (fitted, "^model "),
}
# What is right for some: computed without tracing, or of any shape or kind.
RIGHT = {
    ("saveat", "complex"), ("saveat", "shape"), ("saveat", "dict"), ("sweep", "complex"), ("sweep", "shape"), ("sweep", "dict"),
    ("budget", "shape"), ("CustomQuantity", "shape"), ("CustomQuantity", "numpy"), ("CustomQuantity", "math"), ("CustomQuantity", "if"),
    ("CustomQuantity", "float"), ("own force", "too many arguments"), ("model", "shape"),
}  # fmt: skip
FUNCTIONS = [
    pytest.param(
        lambda take=take, fault=fault: take(fault), f"{name}.*{said}.*; give a function", id=f"{taker}: {kind}"
    )
    for taker, (take, name) in TAKERS.items()
    for kind, (fault, said) in FAULTS.items()
    if (taker, kind) not in RIGHT
    and not (kind == "attribute" and taker in ("model", "sweep", "order_by", "Lagrangian, solve"))
]

# ---- one number where another thing is given

NUMBERS = {
    "length": lambda x: rod(length=x),
    "young": lambda x: rod(young=x),
    "density": lambda x: rod(density=x),
    "tip_mass": lambda x: rod(tip_mass=x),
    "tip_inertia": lambda x: rod(tip_mass=1.0, tip_inertia=x),
    "radius": jaxrod.Uniform,
    "root_radius": lambda x: jaxrod.Cone(x, 0.1),
    "tip_radius": lambda x: jaxrod.Cone(0.1, x),
    "inertia": lambda x: jaxrod.Lumped(x, 1.0, 1.0, 1.0),
    "first_moment": lambda x: jaxrod.Lumped(1.0, x, 1.0, 1.0),
    "stiffness": lambda x: jaxrod.Lumped(1.0, 1.0, x, 1.0),
    "pivot": jaxrod.Rotation,
    "pivot in space": jaxrod.Spherical,
    "pivot of a drive": lambda x: jaxrod.Driven(lambda t: t, x),
    "gravity": lambda x: made(gravity=x),
    "moment": jaxrod.Torque,
    "force": jaxrod.TipForce,
    "coefficient": jaxrod.PivotFriction,
    "time": jaxrod.KelvinVoigt,
    "angle": lambda x: scene().state(angle=x),
    "rate": lambda x: scene().state(rate=x),
    "strain": lambda x: scene().state(strain=x),
    "strain_rate": lambda x: scene().state(strain_rate=x),
    "amplitudes": lambda x: scene().state(amplitudes=x),
    "amplitude_rates": lambda x: scene().state(amplitude_rates=x),
    "azimuth": lambda x: space().state(azimuth=x),
    "azimuth_rate": lambda x: space().state(azimuth_rate=x),
    "center": lambda x: flight().state(center=x),
    "center_velocity": lambda x: flight().state(center_velocity=x),
    "t1": lambda x: run(t1=x),
    "t0": lambda x: run(t1=1.0, t0=x),
    "ts": lambda x: run(ts=x),
    "tolerance": lambda x: run(tolerance=x),
    "dt0": lambda x: run(dt0=x),
    "n_steps": lambda x: run(n_steps=x),
    "angle of rest": lambda x: jaxrod.equilibrium(scene(), angle=x),
    "spin": lambda x: jaxrod.equilibrium(scene(), spin=x),
    "momentum": lambda x: jaxrod.equilibrium(scene(), momentum=x),
    "at": lambda x: jaxrod.LargestStrain(at=x),
    "value": jaxrod.Positive,
    "rate of a spin": lambda x: jaxrod.continuum.steady_spin(scene(), x),
    "rate of frequencies": lambda x: jaxrod.continuum.spinning_frequencies(scene(), x, 2),
    "held": lambda x: jaxrod.continuum.held_free(x, 1.0, 2),
    "first": lambda x: jaxrod.continuum.free_free(x, 1.0, 2),
    "rate of a drive": jaxrod.scenes.steady,
    "t1 of a horizon": lambda x: jaxrod.horizon(scene(), start(), t1=x, tolerance=1e-3),
    "tolerance of a horizon": lambda x: jaxrod.horizon(scene(), start(), t1=1.0, tolerance=x),
    "distance": lambda x: jaxrod.horizon(scene(), start(), t1=1.0, tolerance=1e-3, distance=x),
    "t1 of a plan": lambda x: jaxrod.plan(scene(), start(), t1=x, tolerance=1e-2),
    "tolerance of a plan": lambda x: jaxrod.plan(scene(), start(), t1=1.0, tolerance=x),
    "t1 of a tradeoff": lambda x: jaxrod.tradeoff(scene(), start(), t1=x),
    "seconds": lambda x: jaxrod.tradeoff(scene(), start(), t1=1.0, seconds=x),
    "change": lambda x: jaxrod.continuum.converged(scene(), start(), ts=TS, change=x),
    "strain of a release": lambda x: jaxrod.continuum.release(scene(), x, TS),
}
VALUES = {"text": "thick", "truth": True, "complex": 1 + 2j, "dict": {"a": 1}, "object": object(), "huge": 10**400}
SHAPES = {"list of text": ["a", "b"], "matrix": np.ones((2, 2))}
ROWS_OF_NUMBERS = [
    pytest.param(lambda f=f, x=x: f(x), re.escape(name.split()[0]), id=f"{name}: {kind}")
    for name, f in NUMBERS.items()
    for kind, x in (VALUES | SHAPES).items()
]

# ---- rows by themselves: an id, a call, what its one sentence says

SCENE = r"^system=.*give a System"
VERBS = {
    "natural_frequencies": jaxrod.natural_frequencies,
    "frequency_error": jaxrod.frequency_error,
    "critical_rate": jaxrod.critical_rate,
    "modes": jaxrod.modes,
    "equilibrium": jaxrod.equilibrium,
    "model_limits": jaxrod.model_limits,
    "default_solver": jaxrod.default_solver,
    "default_chart": jaxrod.default_chart,
    "horizon": lambda x: jaxrod.horizon(x, start(), t1=1.0, tolerance=1e-3),
    "plan": lambda x: jaxrod.plan(x, start(), t1=1.0, tolerance=1e-2),
    "tradeoff": lambda x: jaxrod.tradeoff(x, start(), t1=1.0),
    "simulate": lambda x: jaxrod.simulate(x, start(), t1=1.0),
    "on_rung": lambda x: jaxrod.ladder.on_rung(x, start(), jaxrod.Ritz(2)),
    "at_rest": lambda x: jaxrod.ladder.at_rest(x, start()),
    "richer": jaxrod.ladder.richer,
    "condensable": jaxrod.ladder.condensable,
    "figure_2": jaxrod.paper.figure_2,
    "continuum.natural_frequencies": lambda x: jaxrod.continuum.natural_frequencies(x, 2),
    "continuum.critical_rate": jaxrod.continuum.critical_rate,
    "continuum.spinning_frequencies": lambda x: jaxrod.continuum.spinning_frequencies(x, 1.0, 2),
    "continuum.steady_spin": lambda x: jaxrod.continuum.steady_spin(x, 1.0),
    "continuum.simulate": lambda x: jaxrod.continuum.simulate(x, start(), ts=TS),
    "continuum.converged": lambda x: jaxrod.continuum.converged(x, start(), ts=TS, change=1.0),
    "continuum.release": lambda x: jaxrod.continuum.release(x, 0.1, TS),
    "continuum.support": jaxrod.continuum.support,
}
NO_SCENES = {
    "a rod": rod,
    "none": lambda: None,
    "a number": lambda: 3,
    "a Lagrangian": pendulum,
    "a class": lambda: jaxrod.System,
}
SCENES = [
    pytest.param(lambda f=f, x=x: f(x()), SCENE, id=f"{name} of {kind}")
    for name, f in VERBS.items()
    for kind, x in NO_SCENES.items()
    if not (kind == "a Lagrangian" and name in ("default_solver", "simulate"))
]

OF_A_STATE = {
    "kinetic_energy": lambda x: scene().kinetic_energy(x),
    "elastic_energy": lambda x: scene().elastic_energy(x),
    "gravity_energy": lambda x: scene().gravity_energy(x),
    "energy": lambda x: scene().energy(x),
    "power": lambda x: scene().power(0.0, x),
    "angular_momentum": lambda x: scene().angular_momentum(x),
    "tip": lambda x: scene().tip(x),
    "shape": lambda x: scene().shape(x, [0.5]),
    "strain_field": lambda x: scene().strain_field(x, [0.5]),
    "modes": lambda x: jaxrod.modes(scene(), x),
    "on_rung": lambda x: jaxrod.ladder.on_rung(scene(), x, jaxrod.Ritz(2)),
    "at_rest": lambda x: jaxrod.ladder.at_rest(scene(), x),
    "simulate": lambda x: run(scene(), x),
    "continuum.simulate": lambda x: jaxrod.continuum.simulate(scene(), x, ts=TS),
    "horizon": lambda x: jaxrod.horizon(scene(), x, t1=1.0, tolerance=1e-3),
    "plan": lambda x: jaxrod.plan(scene(), x, t1=1.0, tolerance=1e-2),
    "tradeoff": lambda x: jaxrod.tradeoff(scene(), x, t1=1.0),
}
NO_STATES = {
    "many": (many, r"^(state|start|about) has director of shape \(5, 2\).*jax\.vmap"),
    "of space": (lambda: space().state(), r"^(state|start|about) has director of shape \(3,\).*needs \(2,\)"),
    "of a rigid rod": (lambda: rigid().state(), r"^(state|start|about) has .*strains of shape \(0,\)"),
    "a number": (lambda: 3.0, r"^(state|start|about)=3\.0 .*system\.state"),
    "lists": (
        lambda: jaxrod.State([1.0, 0.0], [0.0, 1.0], [0.0], [0.0], 0.0),
        r"^(state|start|about)=State.*system\.state",
    ),
}
STATES = [
    pytest.param(lambda f=f, x=x: f(x()), said, id=f"{name} of {kind}")
    for name, f in OF_A_STATE.items()
    for kind, (x, said) in NO_STATES.items()
]


def off(**changes):
    return dataclasses.replace(start(), **{name: jnp.asarray(x) for name, x in changes.items()})


def twice(function):
    """Of the sweep of a function that makes a scene."""
    return jaxrod.sweep(function, jnp.ones(3))


ROWS = [
    # rods and sections
    ("Rod: nothing", lambda: jaxrod.Rod(), "missing", TypeError),
    ("Rod: unknown keyword", lambda: rod(youngs=1.0), "youngs", TypeError),
    ("Rod: too short", lambda: rod(length=1e-320), r"length=.*give", ValueError),
    ("Rod: too long", lambda: rod(length=1e300), r"length=1e\+300.*give", ValueError),
    ("Rod: tip_inertia alone", lambda: rod(tip_inertia=1.0), r"tip_inertia=1\.0 belongs .*give tip_mass", ValueError),
    ("Rod: section a number", lambda: rod(section=1e-3), r"section=0\.001 is not a section; give", ValueError),
    ("Rod: section a class", lambda: rod(section=jaxrod.Uniform), r"section=", ValueError),
    ("Rod: young a section", lambda: rod(young=jaxrod.Uniform(0.1)), r"young=Uniform.*give", ValueError),
    ("Rod: density a section", lambda: rod(density=jaxrod.Cone(0.1, 0.2)), r"density=Cone.*give", ValueError),
    ("Rod: law a number", lambda: rod(law=2.0), r"law=2\.0 .*give a function", ValueError),
    ("Rod: a list of radii", lambda: rod(section=[0.1, 0.2]), r"section=\[0\.1, 0\.2\] is not a section; give", ValueError),
    ("rod.area: text", lambda: rod().area("a"), r"s='a'.*give", ValueError),
    ("rod.modulus: none", lambda: rod().modulus(None), r"s=None.*give", ValueError),
    ("rod.mass_density: text", lambda: rod().mass_density("a"), r"s='a'.*give", ValueError),
    ("rod.first_moment: text", lambda: rod().first_moment("a"), r"about='a'.*give", ValueError),
    ("rod.moment_of_inertia: list", lambda: rod().moment_of_inertia([1.0, 2.0]), r"about .*\(2,\).*must", ValueError),
    ("Table: no radii", lambda: jaxrod.Table([0.0, 1.0]), r"neither of radii= and areas= given; give", ValueError),
    ("Table: both", lambda: jaxrod.Table([0, 1], [1, 1], areas=[1, 1]), r"both of radii= and areas=.*give", ValueError),
    ("Table: positions text", lambda: jaxrod.Table("ab", [1, 1]), r"Table\(positions=\).*give", ValueError),
    ("Table: positions words", lambda: jaxrod.Table(["a", "b"], [1, 1]), r"Table\(positions=\).*give", ValueError),
    ("Table: positions none", lambda: jaxrod.Table(None, [1, 1]), r"Table\(positions=\).*give", ValueError),
    ("Table: radii words", lambda: jaxrod.Table([0, 1], ["a", "b"]), r"Table\(radii=\).*give", ValueError),
    ("Table: radii too few", lambda: jaxrod.Table([0, 1], [1.0]), r"Table\(radii=\) has shape \(1,\) but must", ValueError),
    ("Table: radii negative", lambda: jaxrod.Table([0, 1], [1.0, -1.0]), r"Table\(radii=\) is -1 .*must", ValueError),
    ("Table: areas complex", lambda: jaxrod.Table([0, 1], areas=[1.0, 1j]), r"Table\(areas=\).*complex; give", ValueError),
    ("Table: matrix", lambda: jaxrod.Table(np.eye(2), np.eye(2)), r"Table\(positions=\) has shape \(2, 2\); give", ValueError),
    ("Table: one point", lambda: jaxrod.Table([0.0], [1.0]), r"holds 1 points; give", ValueError),
    ("Table: not to the tip", lambda: rod(section=jaxrod.Table([0, 0.5], [0.1, 0.1])), r"must reach.*length=1", ValueError),
    ("PiecewiseConstant: breaks text", lambda: jaxrod.PiecewiseConstant("12", [1, 2, 3]), r"breaks='12' must be a sequence", ValueError),
    ("PiecewiseConstant: breaks dict", lambda: jaxrod.PiecewiseConstant({0.5: 1}, [1, 2]), r"breaks=\{0\.5: 1\} must be a sequence", ValueError),
    ("PiecewiseConstant: breaks complex", lambda: jaxrod.PiecewiseConstant([1j], [1, 2]), r"breaks=.*must be a sequence", ValueError),
    ("PiecewiseConstant: values too few", lambda: jaxrod.PiecewiseConstant([0.5], [1.0]), r"PiecewiseConstant\(values=\) has shape \(1,\) but must", ValueError),
    ("PiecewiseConstant: values words", lambda: jaxrod.PiecewiseConstant([0.5], ["a", "b"]), r"PiecewiseConstant\(values=\)=.*give", ValueError),
    ("Profile: a number", lambda: jaxrod.Profile(1e-3), r"section=0\.001 is not a section; give", ValueError),
    ("Profile: breaks none", lambda: jaxrod.Profile(lambda s: 1 + s, breaks=None), r"breaks=None must be a sequence", ValueError),
    # scenes
    ("System: nothing", lambda: jaxrod.System(), "missing", TypeError),
    ("System: unknown keyword", lambda: jaxrod.System(rod(), jaxrod.Rotation(), friction=1.0), "friction", TypeError),
    ("System: rod a section", lambda: jaxrod.System(jaxrod.Uniform(1.0), jaxrod.Rotation()), r"rod=Uniform.*not a rod; give", ValueError),
    ("System: rod a scene", lambda: jaxrod.System(scene(), jaxrod.Rotation()), r"rod=System\(\.\.\.\) is not a rod; give", ValueError),
    ("System: motion text", lambda: jaxrod.System(rod(), "spin"), r"motion='spin' is not a motion; give", ValueError),
    ("System: motion a basis", lambda: jaxrod.System(rod(), jaxrod.Ritz(1)), r"motion=Ritz.*not a motion; give", ValueError),
    ("System: basis a number", lambda: made(basis=3), r"basis=3 is not a basis; give", ValueError),
    ("System: basis a class", lambda: made(basis=jaxrod.Ritz), r"basis=.* is not a basis; give", ValueError),
    ("System: gravity words", lambda: made(gravity=["a", "b"]), r"gravity=.*give", ValueError),
    ("System: gravity of space", lambda: made(gravity=[0.0, 0.0, -9.81]), r"gravity has shape \(3,\) but must", ValueError),
    ("System: one force", lambda: made(forces=jaxrod.Torque(1.0)), r"forces=Torque.*not a sequence.*give", ValueError),
    ("System: forces text", lambda: made(forces="drag"), r"forces='drag' .*give", ValueError),
    ("System: forces none", lambda: made(forces=None), r"forces=None .*give", ValueError),
    ("System: forces functions", lambda: made(forces=[lambda t, s: 1.0]), r"forces holds <function <lambda>>.*give", ValueError),
    ("System: forces a class", lambda: made(forces=[jaxrod.Torque]), r"forces holds .*give", ValueError),
    ("Ritz: truth", lambda: jaxrod.Ritz(True), r"Ritz\(n=True\).*give", ValueError),
    ("Ritz: none", lambda: jaxrod.Ritz(None), r"Ritz\(n=None\).*give", ValueError),
    ("ForceRitz: fraction", lambda: jaxrod.ForceRitz(1.5), r"ForceRitz\(n=1\.5\).*give", ValueError),
    ("LoadRitz: list", lambda: jaxrod.LoadRitz([3]), r"LoadRitz\(n=\[3\]\).*give", ValueError),
    ("LoadRitz: array", lambda: jaxrod.LoadRitz(np.ones(3)), r"LoadRitz\(n=an array of shape \(3,\)\).*give", ValueError),
    ("QuasiStatic: a number", lambda: jaxrod.QuasiStatic(3), r"QuasiStatic\(basis=3\).*give", ValueError),
    ("QuasiStatic: rigid", lambda: jaxrod.QuasiStatic(jaxrod.Ritz(0)), r"QuasiStatic\(basis=.*give", ValueError),
    ("QuasiStatic: a class", lambda: jaxrod.QuasiStatic(jaxrod.Ritz), r"QuasiStatic\(basis=.*give", ValueError),
    ("Driven: a number", lambda: jaxrod.Driven(15.0), r"Driven\(angle=15\.0\) is not a function of time; give", ValueError),
    ("Driven: none", lambda: jaxrod.Driven(None), r"Driven\(angle=None\).*give", ValueError),
    ("Driven: vector", lambda: jaxrod.Driven(lambda t: jnp.ones(1) * t), r"Driven\(angle=\) returned .*\(1,\); give", ValueError),
    ("Rotation: pivot false", lambda: jaxrod.Rotation(False), r"pivot=False is not a number; give", ValueError),
    ("Flight: pivot", lambda: jaxrod.Flight(0.5), "takes", TypeError),
    ("Torque: vector in the plane", lambda: made(forces=[jaxrod.Torque(lambda t, s: jnp.ones(3))]), r"Torque.*\(3,\); give", ValueError),
    ("Torque: (1,)", lambda: made(forces=[jaxrod.Torque(lambda t, s: jnp.ones(1))]), r"Torque.*\(1,\); give", ValueError),
    (
        "Torque: number in space",
        lambda: made(jaxrod.Spherical(), forces=[jaxrod.Torque(lambda t, s: 1.0)]),
        r"Torque\(moment=\) returned .*\(\); give .*three numbers",
        ValueError,
    ),
    ("Torque: none", lambda: jaxrod.Torque(None), r"Torque\(moment=\)=None.*give", ValueError),
    ("TipForce: 3 in the plane", lambda: made(forces=[jaxrod.TipForce(lambda t, s: jnp.ones(3))]), r"TipForce.*\(3,\); give", ValueError),
    ("TipForce: (1,)", lambda: made(forces=[jaxrod.TipForce(lambda t, s: jnp.ones(1))]), r"TipForce.*\(1,\); give", ValueError),
    ("TipForce: 3 numbers in the plane", lambda: made(forces=[jaxrod.TipForce(np.ones(3))]), r"TipForce\(force=.*give", ValueError),
    ("TipForce: matrix", lambda: made(forces=[jaxrod.TipForce(np.ones((2, 2)))]), r"TipForce\(force=\) has shape \(2, 2\) but must", ValueError),
    ("TipForce: none", lambda: jaxrod.TipForce(None), r"TipForce\(force=\)=None.*give", ValueError),
    ("PivotFriction: negative", lambda: made(forces=[jaxrod.PivotFriction(lambda t, s: -1)]), r"returned -1 at t=0; give .*not negative", ValueError),
    ("KelvinVoigt: negative", lambda: made(forces=[jaxrod.KelvinVoigt(lambda t, s: -1e-3)]), r"returned -0\.001 at t=0; give", ValueError),
    ("PivotFriction: in flight", lambda: made(jaxrod.Flight(), forces=[jaxrod.PivotFriction(0.1)]), r"needs a pivot.*take", ValueError),
    ("ShakenBase: a number", lambda: jaxrod.ShakenBase(0.1), r"ShakenBase\(position=0\.1\) is not a function.*give", ValueError),
    ("ShakenBase: nothing", lambda: jaxrod.ShakenBase(), r"neither of position= and acceleration= given; give", ValueError),
    ("ShakenBase: both", lambda: jaxrod.ShakenBase(lambda t: t, acceleration=lambda t: t), r"both of position= and.*give", ValueError),
    ("ShakenBase: acceleration a number", lambda: jaxrod.ShakenBase(acceleration=9.81), r"acceleration=9\.81\) is not a function.*give", ValueError),
    ("ShakenBase: a record of one", lambda: made(forces=[jaxrod.ShakenBase(jaxrod.Record(TS, TS))]), r"position=\) returned .*shape \(\); give", ValueError),
    ("Torque: a record of two", lambda: made(forces=[jaxrod.Torque(jaxrod.Record(TS, np.ones((5, 2))))]), r"moment=\) returned .*\(2,\); give", ValueError),
    ("Driven: a record of two", lambda: jaxrod.Driven(jaxrod.Record(TS, np.ones((5, 2)))), r"angle=\) returned .*\(2,\); give", ValueError),
    *(
        (f"Record: {name}", lambda times=times, samples=samples: jaxrod.Record(times, samples), said, ValueError)
        for name, times, samples, said in (
            ("times text", "now", TS, r"Record\(times=\)='now'.*give"),
            ("times none", None, TS, r"Record\(times=\)=None.*give"),
            ("times complex", TS * 1j, TS, r"Record\(times=\)=.*complex; give"),
            ("times one", TS[:1], TS[:1], r"Record\(times=.*give"),
            ("times back", TS[::-1], TS, r"Record\(times=\) must increase"),
            ("times matrix", np.ones((2, 2)), TS, r"Record\(times=\) has shape \(2, 2\); give"),
            ("samples text", TS, "a", r"Record\(samples=\)='a'.*give"),
            ("samples words", TS, list("abcde"), r"Record\(samples=\)=.*give"),
            ("samples none", TS, None, r"Record\(samples=\)=None.*give"),
            ("samples too few", TS, TS[:3], r"Record\(samples=\) has shape \(3,\) for 5 times; give"),
            ("samples complex", TS, TS * 1j, r"Record\(samples=\).*complex.*give"),
            ("samples nan", TS, TS * math.nan, r"Record\(samples=\)=.*not finite; give"),
            ("samples of rank 3", TS, np.ones((5, 1, 1)), r"Record\(samples=\) has shape \(5, 1, 1\).*give"),
        )
    ),
    *(
        (f"Impulse: {name}", lambda given=given: jaxrod.Impulse(*given), said, ValueError)
        for name, given, said in (
            ("total text", ("a", 0.0, 1.0), r"Impulse\(total=\)='a'.*give"),
            ("total none", (None, 0.0, 1.0), r"Impulse\(total=\)=None.*give"),
            ("total matrix", (np.eye(2), 0.0, 1.0), r"Impulse\(total=\) has shape \(2, 2\) but must"),
            ("total complex", (1j, 0.0, 1.0), r"Impulse\(total=\).*complex.*give"),
            ("start text", (1.0, "a", 1.0), r"Impulse\(start=\)='a'.*give"),
            ("start list", (1.0, [0.0, 1.0], 1.0), r"Impulse\(start=\) has shape \(2,\) but must"),
            ("width zero", (1.0, 0.0, 0.0), r"Impulse\(width=\)=0 must"),
            ("width truth", (1.0, 0.0, True), r"Impulse\(width=\)=True.*give"),
        )
    ),
    ("ShakenBase: one number", lambda: made(forces=[jaxrod.ShakenBase(lambda t: t)]), r"ShakenBase.*shape \(\); give", ValueError),
    (
        "ShakenBase: NumPy",
        lambda: made(forces=[jaxrod.ShakenBase(lambda t: np.array([0.1 * np.sin(t), 0.0]))]),
        r"ShakenBase\(position=\) .*numpy.*written with jax\.numpy",
        ValueError,
    ),
    ("own force: constant power", lambda: made(forces=[Power(lambda v: 5.0)]), r"Power\.power is not linear.*give", ValueError),
    (
        "own force: square power",
        lambda: made(forces=[Power(lambda v: v.direction @ v.direction)]),
        r"Power\.power is not linear in the virtual velocity; give",
        ValueError,
    ),
    ("own force: vector", lambda: made(forces=[Power(lambda v: v.direction)]), r"Power\.power returned .*\(2,\); give", ValueError),
    # states
    ("state: truth", lambda: scene().state(angle=True), r"angle=True is not a number; give", ValueError),
    ("state: unknown keyword", lambda: scene().state(angel=1.0), "angel", TypeError),
    ("state: by position", lambda: scene().state(1.0), "positional", TypeError),
    ("state: too many amplitudes", lambda: scene().state(amplitudes=[0.1, 0.2]), r"amplitudes has shape \(2,\) but must", ValueError),
    ("state: both strains", lambda: scene().state(strain=0.1, amplitudes=[0.1]), r"strain=0\.1 and amplitudes= .*leave", ValueError),
    ("state: a driven angle", lambda: made(jaxrod.Driven(lambda t: t)).state(angle=1.0), r"angle=1.*leave", ValueError),
    ("state: strain text of a rigid rod", lambda: rigid().state(strain="a"), r"strain='a'.*give", ValueError),
    ("start: director twice as long", lambda: run(first=off(direction=[2.0, 0.0])), r"direction=\[2\. 0\.\].*unit length; make", ValueError),
    ("start: rate along the rod", lambda: run(first=off(direction_rate=[1.0, 0.0])), r"direction_rate=.*not across .*make", ValueError),
    (
        "continuum: director twice as long",
        lambda: jaxrod.continuum.simulate(scene(), off(direction=[2.0, 0.0]), ts=TS),
        r"direction=\[2\. 0\.\].*unit length; make",
        ValueError,
    ),
    ("state.azimuth in the plane", lambda: start().azimuth, r"azimuth belongs to Spherical.*ask", AttributeError),
    ("drive_torque of no drive", lambda: scene().drive_torque(0.0, start()), r"motion=Rotation\(\) has no drive; take", ValueError),
    ("shape: a number", lambda: scene().shape(start(), 0.5), r"s has shape \(\); give", ValueError),
    ("shape: text", lambda: scene().shape(start(), "a"), r"s='a'|s has.*give", ValueError),
    ("shape: before the root", lambda: scene().shape(start(), [-1.0]), r"s=\[-1\.\] m goes beyond the rod; give", ValueError),
    ("shape: beyond the tip", lambda: scene().shape(start(), [2.0]), r"s=\[2\.\] m goes beyond the rod; give", ValueError),
    ("strain_field: beyond the tip", lambda: scene().strain_field(start(), [0.5, 1.1]), r"s=.* m goes beyond the rod; give", ValueError),
    ("strain_field: none", lambda: scene().strain_field(start(), None), r"s=None.*give", ValueError),
    ("check_chart: text", lambda: scene().check_chart("angles"), r"chart='angles' .*give", ValueError),
    ("equations: none", lambda: scene().equations(None), r"chart=None .*give", ValueError),
    ("lagrangian: a class", lambda: scene().lagrangian(jaxrod.Angles), r"chart=.* is not a chart; give", ValueError),
    ("equations: of a drive", lambda: scene().equations(jaxrod.Strains()), r"chart=Strains\(\) does not fit.*leave", ValueError),
    # runs
    ("simulate: nothing", lambda: jaxrod.simulate(), "missing", TypeError),
    ("simulate: unknown keyword", lambda: run(t2=1.0), "t2", TypeError),
    ("simulate: times by position", lambda: jaxrod.simulate(scene(), start(), TS), "positional", TypeError),
    ("simulate: ts words", lambda: run(ts=["a", "b"]), r"ts=\['a', 'b'\] is not a number; give", ValueError),
    ("simulate: tolerance of 5", lambda: run(tolerance=5.0), r"tolerance=5 .*give", ValueError),
    ("simulate: tolerance of a quantity", lambda: run(tolerance=jaxrod.FinalTip()), r"tolerance=FinalTip.*give", ValueError),
    ("simulate: chart text", lambda: run(chart="angles"), r"chart='angles' does not fit; give", ValueError),
    ("simulate: chart a class", lambda: run(chart=jaxrod.Angles), r"chart=.*does not fit; give", ValueError),
    ("simulate: chart of a Lagrangian", lambda: run(pendulum(), (np.ones(1), np.ones(1)), chart=jaxrod.Angles()), r"chart=Angles.*give", ValueError),
    ("simulate: solver text", lambda: run(solver="dopri8"), r"solver='dopri8' is not a solver; give", ValueError),
    ("simulate: solver a class", lambda: run(solver=diffrax.Tsit5), r"solver=.*is not a solver; give", ValueError),
    ("simulate: solver of fits", lambda: run(solver=optax.adam(0.1)), r"solver=.*is not a solver; give", ValueError),
    ("simulate: stepsize_controller text", lambda: run(stepsize_controller="pid"), r"stepsize_controller='pid' .*give", ValueError),
    ("simulate: stepsize_controller a number", lambda: run(stepsize_controller=0.1), r"stepsize_controller=0\.1 .*give", ValueError),
    ("simulate: saveat text", lambda: run(saveat="steps"), r"saveat='steps' .*give", ValueError),
    ("simulate: saveat times", lambda: run(saveat=TS), r"saveat=.*give", ValueError),
    ("simulate: saveat beyond", lambda: run(saveat=diffrax.SaveAt(ts=[0.5])), r"saveat\.ts=.*must lie between", ValueError),
    ("simulate: event a function", lambda: run(event=lambda t, y, args, **_: y.angle), r"event=<function <lambda>>.*give", ValueError),
    ("simulate: event a number", lambda: run(event=1.0), r"event=1\.0 .*give", ValueError),
    ("simulate: event of a number", lambda: run(event=diffrax.Event([1.0])), r"event=1\.0 .*give", ValueError),
    ("simulate: event vector", lambda: run(event=diffrax.Event(lambda t, y, args, **_: y.direction)), r"event returned .*\(2,\); give", ValueError),
    ("simulate: adjoint text", lambda: run(adjoint="forward"), r"adjoint='forward' .*give", ValueError),
    ("simulate: adjoint a class", lambda: run(adjoint=diffrax.ForwardMode), r"adjoint=.*give", ValueError),
    ("simulate: progress_meter text", lambda: run(progress_meter="tqdm"), r"progress_meter='tqdm' .*give", ValueError),
    ("simulate: progress_meter truth", lambda: run(progress_meter=True), r"progress_meter=True .*give", ValueError),
    *(
        (f"simulate: max_steps {x!r}", lambda x=x: run(max_steps=x), rf"max_steps={re.escape(repr(x))} must", ValueError)
        for x in (True, 0, -1, 1.5, "a", None)
    ),
    *(
        (f"simulate: n_steps {x!r}", lambda x=x: run(n_steps=x), r"n_steps.*(must|give)", ValueError)
        for x in (0, -3, 2.5, "many", [10, 20])
    ),
    *((f"simulate: throw {x!r}", lambda x=x: run(throw=x), rf"throw={x!r} must be", ValueError) for x in ("no", 0, None)),
    ("simulate: budget empty", lambda: run(budget=[]), r"budget=\[\] asks for nothing; give", ValueError),
    ("simulate: budget of none", lambda: run(budget=[None]), r"budget=\[None\] asks for nothing; give", ValueError),
    ("simulate: budget text", lambda: run(budget="tip"), r"quantity 'tip' cannot be asked for; give", ValueError),
    ("simulate: budget truth", lambda: run(budget=True), r"quantity True cannot be asked for; give", ValueError),
    ("simulate: budget a class", lambda: run(budget=jaxrod.FinalTip), r"quantity FinalTip cannot be asked for; give", ValueError),
    ("simulate: start none", lambda: jaxrod.simulate(scene(), None, t1=1.0), r"start=None does not fit; .*give", ValueError),
    ("simulate: start a solution", lambda: run(first=sol()), r"start=Solution\(\.\.\.\) does not fit; .*give", ValueError),
    ("Lagrangian: a number", lambda: jaxrod.Lagrangian(3), r"Lagrangian\(function=3\) is not a function; give", ValueError),
    ("Lagrangian: force a number", lambda: jaxrod.Lagrangian(lambda t, q, v: v @ v, force=1.0), r"Lagrangian\(force=1\.0\).*give", ValueError),
    ("Lagrangian: solve text", lambda: jaxrod.Lagrangian(lambda t, q, v: v @ v, solve="lu"), r"Lagrangian\(solve='lu'\).*give", ValueError),
    *(
        (f"Lagrangian: start {name}", lambda x=x: run(pendulum(), x), said, ValueError)
        for name, x, said in (
            ("text", "ab", r"start='ab' does not fit; .*give"),
            ("words", ("a", "b"), r"q='a' is not numbers; give"),
            ("one", (np.ones(1),), r"start=.*does not fit; .*pair"),
            ("three", (np.ones(1),) * 3, r"start=.*does not fit; .*pair"),
            ("alike not", (np.ones(1), np.ones(2)), r"q has shape \(1,\) and v has shape \(2,\); give"),
            ("empty", (np.ones(0), np.ones(0)), r"q has shape \(0,\).*give"),
            ("matrix", (np.eye(2), np.eye(2)), r"q has shape \(2, 2\).*give"),
            ("numbers", (1.0, 2.0), r"q has shape \(\).*give"),
            ("complex", (np.ones(1) * 1j, np.ones(1)), r"q holds numbers of type complex128; give"),
            ("truth", (np.array([True]), np.ones(1)), r"q holds numbers of type bool; give"),
        )
    ),
    ("Lagrangian: energy of text", lambda: pendulum().energy(0.0, "a", "b"), r"q='a' is not numbers; give", ValueError),
    ("Lagrangian: acceleration alike not", lambda: pendulum().acceleration(0.0, np.ones(1), np.ones(2)), r"q has shape .*give", ValueError),
    ("Lagrangian: momentum of none", lambda: pendulum().momentum(0.0, None, None), r"q=None is not numbers; give", ValueError),
    ("Lagrangian: mass_matrix of numbers", lambda: pendulum().mass_matrix(0.0, 1.0, 1.0), r"q has shape \(\).*give", ValueError),
    ("Lagrangian: a budget", lambda: run(pendulum(), (np.ones(1), np.ones(1)), budget=jaxrod.FinalTip()), r"budget=FinalTip.*compare", ValueError),
    ("Unrolled: a number", lambda: jaxrod.Unrolled(3), r"Unrolled\(method=3\).*give", ValueError),
    ("Unrolled: implicit", lambda: jaxrod.Unrolled(diffrax.Kvaerno5()), r"Unrolled\(method=.*give", ValueError),
    # solutions
    ("sol.shape: a number", lambda: sol().shape(0.5), r"s has shape \(\); give", ValueError),
    ("sol.shape: text", lambda: sol().shape("a"), r"s='a'.*give", ValueError),
    ("sol.shape: beyond", lambda: sol().shape([2.0]), r"s=\[2\.\] m goes beyond the rod; give", ValueError),
    ("sol.strain_field: beyond", lambda: sol().strain_field([2.0]), r"s=\[2\.\] m goes beyond the rod; give", ValueError),
    ("sol.strain_field: complex", lambda: sol().strain_field([1j]), r"s=.* complex; give", ValueError),
    ("sol.azimuth in the plane", lambda: sol().azimuth, r"azimuth belongs to Spherical.*ask", AttributeError),
    *(
        (f"sol.{name} of a Lagrangian", lambda name=name: getattr(own(), name), r"ask for sol\.states", AttributeError)
        for name in ("angle", "rate", "strain", "tip", "director", "angular_momentum", "center")
    ),
    ("sol.ledger of a Lagrangian", lambda: own().ledger, r"a ledger needs a System.*ask", ValueError),
    ("sol.shape of a Lagrangian", lambda: own().shape([0.5]), r"ask for sol\.states", AttributeError),
    # many scenes
    ("sweep: a number", lambda: jaxrod.sweep(3, jnp.ones(3)), r"fn=3 is not a function; give", ValueError),
    ("sweep: inputs none", lambda: jaxrod.sweep(lambda x: x, None), r"inputs have shapes .*give", ValueError),
    ("sweep: inputs words", lambda: jaxrod.sweep(lambda x: x, np.array(["a", "b"])), r"inputs holds .*give", ValueError),
    ("sweep: inputs text", lambda: jaxrod.sweep(lambda x: x, "ab"), r"inputs holds 'ab'.*give", ValueError),
    *(
        (f"sweep: {name} {x!r}", lambda name=name, x=x: jaxrod.sweep(lambda x: x, jnp.ones(3), **{name: x}), f"{name}.*(must|give|call)", ValueError)
        for name, x in (
            ("block", 0), ("block", 1.5), ("block", "a"), ("block", True), ("devices", 0), ("devices", "all"), ("devices", True),
            ("devices", 10_000), ("progress", "bar"), ("progress", 1), ("order_by", [1.0]), ("order_by", "cost"),
            ("order_by", [math.nan] * 3), ("order_by", 2.0),
        )
    ),
    ("sweep: a rod of minus one", lambda: twice(lambda x: rod(section=lambda s: "a").mass), r"fn raised ValueError: section.*give", ValueError),
    # questions
    ("equilibrium: spin and momentum", lambda: jaxrod.equilibrium(scene(), spin=1.0, momentum=1.0), r"spin=1 and momentum=1.*leave", ValueError),
    ("equilibrium: of a drive", lambda: jaxrod.equilibrium(made(jaxrod.Driven(lambda t: t)), spin=1.0), r"Driven.*leave", ValueError),
    ("modes: no rest", lambda: jaxrod.modes(made(basis=jaxrod.Ritz(0), gravity=9.81), rigid().state()), r"about= is no equilibrium.*take", ValueError),
    ("critical_rate: rigid", lambda: jaxrod.critical_rate(rigid()), r"Ritz\(0\) is rigid.*take", ValueError),
    ("model_limits: Lumped", lambda: jaxrod.model_limits(jaxrod.System(body(), jaxrod.Rotation())), r"rod=Lumped.*give a Rod", ValueError),
    ("ladder.on_rung: a number", lambda: jaxrod.ladder.on_rung(scene(), start(), 3), r"basis=3 is not a basis; give", ValueError),
    ("ladder.on_rung: Lumped", lambda: jaxrod.ladder.on_rung(jaxrod.System(body(), jaxrod.Rotation()), start(), jaxrod.Ritz(2)), r"Lumped.*give", ValueError),
    *(
        (f"plan: {name}", lambda more=more: jaxrod.plan(scene(), start(), **{"t1": 1.0, "tolerance": 1e-2} | more), said, ValueError)
        for name, more, said in (
            ("quantity text", {"quantity": "tip"}, r"quantity 'tip' .*give"),
            ("quantity a class", {"quantity": jaxrod.FinalTip}, r"quantity FinalTip .*give"),
            ("static text", {"static": "yes"}, r"static='yes' must be"),
            ("before the start", {"t0": 2.0}, r"t1=1 does not lie after t0=2; give"),
        )
    ),
    *(
        (f"tradeoff: {name}", lambda more=more: jaxrod.tradeoff(scene(), start(), **{"t1": 1.0} | more), said, ValueError)
        for name, more, said in (
            ("quantity a number", {"quantity": 3}, r"quantity 3 .*give"),
            ("static a number", {"static": 1}, r"static=1 must be"),
            ("seconds none", {"seconds": None}, r"seconds=None .*give"),
            ("seconds zero", {"seconds": 0}, r"seconds=0 .*give"),
            ("progress text", {"progress": "bar"}, r"progress='bar' must be"),
        )
    ),
    ("horizon: distance above tolerance", lambda: jaxrod.horizon(scene(), start(), t1=1.0, tolerance=1e-3, distance=1.0), r"distance=1 .*must", ValueError),
    ("horizon: rigid and driven", lambda: jaxrod.horizon(*_rigid_drive(), t1=1.0, tolerance=1e-3), r"Driven\(\).*take", ValueError),
    ("continuum.natural_frequencies: n beyond patience", lambda: jaxrod.continuum.natural_frequencies(scene(), 100_000), "n=100000 must be a whole number of frequencies, 1 to 2000", ValueError),
    ("CustomQuantity: a number", lambda: jaxrod.CustomQuantity(3), r"CustomQuantity\(function=3\) is not a function; give", ValueError),
    ("CustomQuantity: text", lambda: jaxrod.CustomQuantity("a"), r"CustomQuantity\(function='a'\) is not a function; give", ValueError),
    ("CustomQuantity: a class", lambda: jaxrod.CustomQuantity(jaxrod.FinalTip), r"CustomQuantity\(function=.*give", ValueError),
    ("CustomQuantity: unit 3", lambda: jaxrod.CustomQuantity(lambda sol: 1.0, unit=3), r"CustomQuantity\(unit=3\) is not text; give", ValueError),
    ("CustomQuantity: name none", lambda: jaxrod.CustomQuantity(lambda sol: 1.0, name=None), r"CustomQuantity\(name=None\) is not text; give", ValueError),
    ("CustomQuantity: largest text", lambda: jaxrod.CustomQuantity(lambda sol: 1.0, largest="a"), r"CustomQuantity\(largest=\)='a'.*give", ValueError),
    ("CustomQuantity: largest of another shape", lambda: jaxrod.CustomQuantity(lambda sol: sol.tip[-1], largest=jnp.ones(3))(sol()), r"CustomQuantity\(largest=\) of shape \(3,\) does not fit the quantity, of shape \(2,\)", ValueError),
    ("CustomQuantity: largest negative", lambda: jaxrod.CustomQuantity(lambda sol: 1.0, largest=-1.0), r"CustomQuantity\(largest=-1\.0\) must be", ValueError),
    ("LargestStrain: beyond the rod", lambda: jaxrod.LargestStrain(at=2.0)(sol()), r"at=2 m lies beyond the rod; it must", ValueError),
    # the exact rod
    *(
        (f"continuum.natural_frequencies: n {x!r}", lambda x=x: jaxrod.continuum.natural_frequencies(scene(), x), rf"n={re.escape(repr(x))} must", ValueError)
        for x in (0, -1, 1.5, "two", None, True)
    ),
    ("continuum.spinning_frequencies: n 0", lambda: jaxrod.continuum.spinning_frequencies(scene(), 1.0, 0), r"n=0 must", ValueError),
    ("continuum.spinning_frequencies: free", lambda: jaxrod.continuum.spinning_frequencies(scene(), 1.0, 2, free="yes"), r"free='yes' must", ValueError),
    ("continuum.release: n 0", lambda: jaxrod.continuum.release(scene(), 0.1, TS, n=0), r"n=0 must", ValueError),
    ("continuum.release: ts text", lambda: jaxrod.continuum.release(scene(), 0.1, "now"), r"ts='now' is not a number; give", ValueError),
    ("continuum.held_free: n text", lambda: jaxrod.continuum.held_free(1.0, 1.0, "two"), r"n='two' must", ValueError),
    ("continuum.held_free: negative", lambda: jaxrod.continuum.held_free(-1.0, 1.0, 2), r"held=-1 must not be negative; give", ValueError),
    ("continuum.free_free: negative", lambda: jaxrod.continuum.free_free(1.0, -1.0, 2), r"second=-1 must not be negative; give", ValueError),
    *(
        (f"continuum.simulate: {name}", lambda more=more: jaxrod.continuum.simulate(scene(), start(), **{"ts": TS} | more), said, ValueError)
        for name, more, said in (
            ("ts text", {"ts": "now"}, r"ts='now' is not a number; give"),
            ("ts a number", {"ts": 1.0}, r"ts has shape \(\); give"),
            ("ts back", {"ts": TS[::-1]}, r"ts=.* must increase"),
            ("modes 1", {"modes": 1}, r"modes=1 must"),
            ("modes text", {"modes": "many"}, r"modes='many' must"),
            ("modes truth", {"modes": True}, r"modes=True must"),
            ("tolerance zero", {"tolerance": 0.0}, r"tolerance=0 must"),
            ("tolerance text", {"tolerance": "a"}, r"tolerance='a'.*give"),
            ("static text", {"static": "no"}, r"static='no' must"),
            ("error text", {"error": "no"}, r"error='no' must"),
            ("t0 text", {"t0": "a"}, r"t0='a'.*give"),
        )
    ),
    *(
        (f"continuum.converged: {name}", lambda more=more: jaxrod.continuum.converged(scene(), start(), **{"ts": TS, "change": 1.0} | more), said, ValueError)
        for name, more, said in (
            ("quantity text", {"quantity": "tip"}, r"quantity='tip' is not a function; give"),
            ("change negative", {"change": -1.0}, r"change=-1 must"),
            ("modes text", {"modes": "a"}, r"modes='a' must"),
            ("most too few", {"most": 16}, r"most=16 .*give"),
            ("most none", {"most": None}, r"most=None must"),
        )
    ),
    # identification
    ("fit: data none", lambda: fitted(data=None), r"data.*(must|give)", ValueError),
    ("fit: data words", lambda: fitted(data=["a", "b"]), r"data.*(must|give)", ValueError),
    ("fit: data empty", lambda: fitted(data=[]), r"data.*(must|give)", ValueError),
    ("fit: data complex", lambda: fitted(data=[1j, 1.0]), r"data.*(must|give)", ValueError),
    ("fit: data nan", lambda: fitted(data=[math.nan, 1.0]), r"data.*(must|give)", ValueError),
    ("fit: sigma text", lambda: fitted(sigma="a"), r"sigma.*(must|give)", ValueError),
    ("fit: sigma none", lambda: fitted(sigma=None), r"sigma.*(must|give)", ValueError),
    ("fit: sigma negative", lambda: fitted(sigma=-1.0), r"sigma.*(must|give)", ValueError),
    ("fit: sigma zero", lambda: fitted(sigma=0.0), r"sigma.*(must|give)", ValueError),
    ("fit: sigma too many", lambda: fitted(sigma=[1.0, 1.0, 1.0]), r"sigma.*(must|give)", ValueError),
    ("fit: start empty", lambda: fitted(start={}), r"start=.*give", ValueError),
    ("fit: start text", lambda: fitted(start={"a": "x"}), r"start.*give", ValueError),
    ("fit: start of another name", lambda: fitted(start={"b": 1.0}), r"model raised KeyError: 'a'; give", ValueError),
    ("fit: start an array", lambda: fitted(start={"a": np.ones(3)}), r"start.*shape \(3,\)", ValueError),
    ("fit: model none", lambda: fitted(model=None), r"model=None is not a function; give", ValueError),
    ("fit: model a number", lambda: fitted(model=3.0), r"model=3\.0 is not a function; give", ValueError),
    ("fit: model of another shape", lambda: fitted(model=lambda p: p["a"]), r"model returns shape \(\)|model returned", ValueError),
    ("fit: model Python float", lambda: fitted(model=lambda p: np.array([float(p["a"])] * 2)), r"model .*numpy, math, float", ValueError),
    ("fit: solver text", lambda: fitted(solver="lm"), r"solver='lm' is no solver; give", ValueError),
    ("fit: solver of motions", lambda: fitted(solver=diffrax.Tsit5()), r"solver=.* is no solver; give", ValueError),
    ("fit: solver a class", lambda: fitted(solver=optax.adam), r"solver=.* is no solver; give", ValueError),
    *(
        (f"fit: max_steps {x!r}", lambda x=x: fitted(max_steps=x), rf"max_steps={re.escape(repr(x))} must", ValueError)
        for x in (1.5, "a", 0, -1, True)
    ),
    # laws, pictures, the paper, settings
    *(
        (f"law.{law.__name__}: {kind}", lambda law=law, x=x: law(x), r"strain(=| holds).*give", ValueError)
        for law in (jaxrod.law.hooke, jaxrod.law.green, jaxrod.law.logarithmic, jaxrod.law.neo_hookean)
        for kind, x in (("text", "a"), ("none", None), ("complex", 1j), ("truth", True))
    ),
    ("paper.rod: an argument", lambda: jaxrod.paper.rod(1.0), "takes", TypeError),
    ("paper.literal: text", lambda: jaxrod.paper.literal("g"), r"gravity='g'.*give", ValueError),
    ("paper.corrected: negative", lambda: jaxrod.paper.corrected(-1.0), r"gravity=-1 must", ValueError),
    ("plot.tradeoff: none", lambda: jaxrod.plot.tradeoff(None), r"found=None is not a trade-off; give", ValueError),
    ("plot.tradeoff: a plan", lambda: jaxrod.plot.tradeoff(sol()), r"found=Solution\(\.\.\.\) is not a trade-off; give", ValueError),
    ("plot.bands: a solution", lambda: jaxrod.plot.bands(sol(), {}, 1.0), r"solutions=Solution\(\.\.\.\) is not a mapping; give", ValueError),
    ("plot.bands: no slow", lambda: jaxrod.plot.bands({"a": sol()}, None, 1.0), r"slow=None is not a mapping; give", ValueError),
    ("plot.bands: other titles", lambda: jaxrod.plot.bands({"a": sol()}, {"b": (TS, TS)}, 1.0), r"slow has titles .*give", ValueError),
    ("plot.bands: of a Lagrangian", lambda: jaxrod.plot.bands({"a": own()}, {"a": (TS, TS)}, 1.0), r"solutions=.*give", ValueError),
    ("plot.bands: until text", lambda: jaxrod.plot.bands({"a": sol()}, {"a": (TS, TS)}, "end"), r"until='end'.*give", ValueError),
    ("plot.release: none", lambda: jaxrod.plot.release(TS, None), r"tips=None is not a mapping; give", ValueError),
    ("plot.release: one", lambda: jaxrod.plot.release(TS, {"a": TS}), r"tips\['a'\] does not fit; give", ValueError),
    ("plot.release: tau text", lambda: jaxrod.plot.release("a", {"a": (TS, TS)}), r"tau='a'.*give", ValueError),
    ("configure: x64 text", lambda: jaxrod.configure(x64="no"), r"x64='no' must be", ValueError),
    ("configure: devices 0", lambda: jaxrod.configure(devices=0), r"devices=0 must be", ValueError),
    ("configure: devices truth", lambda: jaxrod.configure(devices=True), r"devices=True must be", ValueError),
    ("configure: devices text", lambda: jaxrod.configure(devices="all"), r"devices='all' must be", ValueError),
    ("configure: cache a number", lambda: jaxrod.configure(cache=3), r"cache=3 must be", ValueError),
    ("configure: unknown keyword", lambda: jaxrod.configure(float64=True), "float64", TypeError),
]  # fmt: skip


def _rigid_drive():
    system = made(jaxrod.Driven(lambda t: 5.0 * t), jaxrod.Ritz(0))
    return system, system.state()


WARNED = [
    (
        "KelvinVoigt of a rigid rod",
        lambda: made(basis=jaxrod.Ritz(0), forces=[jaxrod.KelvinVoigt(1e-3)]),
        r"does nothing .*leave",
    ),
    (
        "KelvinVoigt of a quasi-static rod",
        lambda: made(basis=jaxrod.QuasiStatic(jaxrod.Ritz(1)), forces=[jaxrod.KelvinVoigt(1e-3)]),
        r"KelvinVoigt\(\) does nothing with basis=.*leave",
    ),
    ("configure again, else", lambda: jaxrod.configure(devices=1), r"configure\(\) was called before, and stays"),
    (
        "stiffer than any solid",
        lambda: rod(
            young=jaxrod.PiecewiseConstant([0.5], [1e12, 2e12]), density=jaxrod.PiecewiseConstant([0.5], [1e3, 1e3])
        ),
        r"young=",
    ),
]


def answered(call, said, kind=ValueError):
    with warnings.catch_warnings(), pytest.raises(kind) as caught:
        warnings.simplefilter("ignore")
        call()
    text = str(caught.value)
    assert type(caught.value) is kind, text
    assert "\n" not in text and len(text) < 400, text
    assert not INTERNAL.search(text), text
    assert re.search(said, text), text
    if kind is ValueError:
        assert REMEDY.search(text) and text.endswith("."), text


@pytest.mark.parametrize(("call", "said"), FUNCTIONS)
def test_functions(call, said):
    answered(call, said)


@pytest.mark.parametrize(("call", "said"), ROWS_OF_NUMBERS)
def test_numbers(call, said):
    answered(call, said)


@pytest.mark.parametrize(("call", "said"), SCENES)
def test_scenes(call, said):
    answered(call, said)


@pytest.mark.parametrize(("call", "said"), STATES)
def test_states(call, said):
    answered(call, said)


@pytest.mark.parametrize(("call", "said", "kind"), [pytest.param(*row[1:], id=row[0]) for row in ROWS])
def test_rows(call, said, kind):
    answered(call, said, kind)


@pytest.mark.parametrize(("call", "said"), [pytest.param(*row[1:], id=row[0]) for row in WARNED])
def test_warned(call, said):
    with pytest.warns(UserWarning, match=said):
        call()
