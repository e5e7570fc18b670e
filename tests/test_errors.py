"""Wrong inputs are answered at once, in one sentence that names the argument, its value and the remedy."""

import dataclasses
import functools
import math
import re

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import make_rod, scene

import jaxrod

NUMBERS = {
    "young": (lambda x: _rod(young=x), r"young={}"),
    "density": (lambda x: _rod(density=x), r"density={}"),
    "length": (lambda x: _rod(length=x), r"length={}"),
    "Uniform.radius": (lambda x: jaxrod.Uniform(radius=x), r"Uniform\(radius=\)={}"),
    "Cone.root_radius": (lambda x: jaxrod.Cone(x, 0.1), r"Cone\(root_radius=\)={}"),
    "Cone.tip_radius": (lambda x: jaxrod.Cone(0.1, x), r"Cone\(tip_radius=\)={}"),
    "Lumped.inertia": (lambda x: _lumped(inertia=x), r"inertia={}"),
    "Lumped.first_moment": (lambda x: _lumped(first_moment=x), r"first_moment={}"),
    "Lumped.stiffness": (lambda x: _lumped(stiffness=x), r"stiffness={}"),
    "Lumped.length": (lambda x: _lumped(length=x), r"length={}"),
    "Rotation.pivot": (lambda x: jaxrod.Rotation(pivot=x), r"pivot={}"),
    "Spherical.pivot": (lambda x: jaxrod.Spherical(pivot=x), r"pivot={}"),
    "gravity": (lambda x: _scene(gravity=x), r"gravity={}"),
    "PivotFriction.coefficient": (lambda x: jaxrod.PivotFriction(x), r"PivotFriction\(coefficient=\)={}"),
    "Torque.moment": (lambda x: jaxrod.Torque(x), r"Torque\(moment=\)={}"),
    "angle": (lambda x: _scene().state(angle=x), r"angle={}"),
    "rate": (lambda x: _scene().state(rate=x), r"rate={}"),
    "strain": (lambda x: _scene().state(strain=x), r"strain={}"),
    "strain_rate": (lambda x: _scene().state(strain_rate=x), r"strain_rate={}"),
    "azimuth": (lambda x: _scene(jaxrod.Spherical()).state(azimuth=x), r"azimuth={}"),
    "azimuth_rate": (lambda x: _scene(jaxrod.Spherical()).state(azimuth_rate=x), r"azimuth_rate={}"),
    "t1": (lambda x: _simulate(t1=x), r"t1={}"),
    "t0": (lambda x: _simulate(t1=1.0, t0=x), r"t0={}"),
    "tolerance": (lambda x: _simulate(t1=1.0, tolerance=x), r"tolerance={}"),
}
ANY_SIGN = {"first_moment", "moment", "angle", "rate", "strain", "strain_rate", "azimuth", "azimuth_rate", "t1", "t0"}
MAY_BE_ZERO = ANY_SIGN | {"root_radius", "tip_radius", "pivot", "gravity", "coefficient"}

_rod = functools.partial(make_rod, section=jaxrod.Uniform(0.025))
_scene = functools.partial(scene, rod=_rod())


def _lumped(**numbers):
    return jaxrod.Lumped(**{"inertia": 1.0, "first_moment": 1.0, "stiffness": 1.0, "length": 1.0} | numbers)


def _simulate(system=None, start=None, **keywords):
    system = _scene() if system is None else system
    return jaxrod.simulate(system, system.state() if start is None else start, **keywords)


def _fields(but=frozenset()):
    return [name for name in NUMBERS if name.split(".")[-1] not in but]


def _refused(call, match):
    """A ValueError whose text is one sentence (or one and its remedy) and matches."""
    with pytest.raises(ValueError, match=match) as caught:
        call()
    text = str(caught.value)
    assert text.endswith(".") and "\n" not in text and len(text) < 300, text


# ---- numbers


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", _fields())
def test_not_finite(name, value):
    make, pattern = NUMBERS[name]
    _refused(lambda: make(value), pattern.format(value) + " is not finite")


@pytest.mark.parametrize("value", ["thick", None, 1 + 2j])
@pytest.mark.parametrize("name", _fields(but={"gravity", "pivot", "azimuth", "azimuth_rate", "t1", "tolerance"}))
def test_not_a_number(name, value):
    """None is left out for the few that may be None: the next test."""
    make, pattern = NUMBERS[name]
    _refused(lambda: make(value), pattern.format(re.escape(repr(value))))


@pytest.mark.parametrize(
    "name", ["gravity", "Rotation.pivot", "Spherical.pivot", "azimuth", "azimuth_rate", "t1", "tolerance"]
)
def test_not_a_number_where_none_has_a_meaning(name):
    make, pattern = NUMBERS[name]
    _refused(lambda: make("thick"), pattern.format("'thick'"))


@pytest.mark.parametrize("name", _fields(but=ANY_SIGN))
def test_negative(name):
    make, pattern = NUMBERS[name]
    _refused(lambda: make(-0.25), pattern.format(r"-0\.25") + " must (be positive|not be negative)")


@pytest.mark.parametrize("name", _fields(but=MAY_BE_ZERO))
def test_zero(name):
    make, pattern = NUMBERS[name]
    _refused(lambda: make(0.0), pattern.format(0) + " must be positive")


@pytest.mark.parametrize("name", _fields(but={"moment"}))
def test_an_array_for_a_number(name):
    """Many scenes are a job for vmap, and the message says so."""
    make, pattern = NUMBERS[name]
    name = pattern.removesuffix("={}")
    if name == "gravity":  # three numbers are a vector in space
        name, shape = "gravity", r" has shape \(3,\) but must be an array of shape \(2,\)"
        _refused(lambda: make(np.full(3, 0.5)), name + shape)
        return
    _refused(lambda: make(np.full(3, 0.5)), name + r" has shape \(3,\) but must be one number; .*jax.vmap")


def test_what_may_be_zero():
    """The refusals above are not too eager."""
    for name in set(_fields()) - set(_fields(but=MAY_BE_ZERO)) - {"t0", "t1"}:
        NUMBERS[name][0](0)


# ---- rods


def test_unit_slip_is_named():
    """The paper prints 10^7 MPa for rubber: the wave speed gives it away."""
    with pytest.warns(UserWarning, match=r"wave speed.*young=1e\+13 in Pa.*density=1200"):
        _rod(young=1e13)
    with pytest.warns(UserWarning, match=r"young=2e\+11.*density=7\.8 "):
        _rod(young=2e11, density=7.8)


@pytest.mark.parametrize(
    ("section", "match"),
    [
        (lambda s: 1e-3 * (0.5 - s), r"section has area -\S+ m\^2 at s=0\.5\d"),
        (lambda s: 0.0 * s, r"section has area 0 m\^2 at s="),
        (lambda s: jnp.sqrt(0.5 - s), r"section has area nan m\^2 at s=0\.5\d"),
        (0.025, r"section=0\.025 is not a section; give Uniform, Cone, Table or a function"),
        ("round", r"section='round' is not a section"),
        (None, r"section=None is not a section"),
    ],
)
def test_sections(section, match):
    _refused(lambda: _rod(section=section), match)


def test_cone_of_nothing():
    _refused(lambda: jaxrod.Cone(0, 0.0), r"root_radius=0, tip_radius=0.*at most one end")


def test_breaks_out_of_order():
    _refused(lambda: jaxrod.Profile(lambda s: 1 + s, breaks=(0.5, 0.2)), r"breaks=\(0\.5, 0\.2\) must increase")
    _refused(lambda: jaxrod.Profile(lambda s: 1 + s, breaks=(0.5, 0.5)), r"breaks=\(0\.5, 0\.5\) must increase")


def test_replace_checks_again():
    _refused(lambda: dataclasses.replace(_rod(), young=-1.0), "young=-1 must be positive")
    _refused(lambda: dataclasses.replace(_scene(), motion=jaxrod.Rotation(1.5)), r"pivot=1\.5 lies beyond")


# ---- scenes


@pytest.mark.parametrize("motion", [jaxrod.Rotation, jaxrod.Spherical])
def test_pivot(motion):
    _refused(lambda: _scene(motion(1.25)), r"pivot=1\.25 lies beyond the rod.*length=1 m")
    pointed = _rod(section=jaxrod.Cone(0.0, 0.1))
    _refused(lambda: _scene(motion(0.0), rod=pointed), r"pivot=0 m is where the section vanishes.*move the pivot")
    pointed = _rod(section=jaxrod.Cone(0.1, 0.0))
    _refused(lambda: _scene(motion(1.0), rod=pointed), r"pivot=1 m is where the section vanishes")
    _scene(motion(0.0), rod=pointed)  # held by its thick end all is well


def test_lumped_bodies():
    _refused(lambda: _scene(jaxrod.Flight(), rod=_lumped()), r"rod=Lumped.*Flight\(\)")
    _refused(lambda: _scene(jaxrod.Rotation(0.5), rod=_lumped()), r"rod=Lumped.*leave out pivot=")


@pytest.mark.parametrize("basis", [jaxrod.Ritz, jaxrod.ForceRitz])
@pytest.mark.parametrize("n", [2.0, -1, "1"])
def test_rungs(n, basis):
    _refused(lambda: basis(n), rf"{basis.__name__}\(n={n!r}\) is not available; give a whole number")


def test_what_a_scene_is_made_of():
    _refused(lambda: jaxrod.System(1.0, jaxrod.Rotation()), r"rod=1\.0 is not a rod; .*Rod\(length")
    _refused(
        lambda: jaxrod.System(_rod(), jaxrod.Rotation), r"motion=<class .*Rotation'> is not a motion; .*Rotation\(\)"
    )
    _refused(lambda: jaxrod.System(_rod(), None), r"motion=None is not a motion")


def test_forces():
    space, plane, flight = jaxrod.Spherical(), jaxrod.Rotation(), jaxrod.Flight()
    torque, vector = jaxrod.Torque(2.0), jaxrod.Torque(jnp.array([0.0, 0.0, 2.0]))
    _refused(lambda: _scene(space, forces=(torque,)), r"Torque\(moment=2\) .* three numbers in space")
    _refused(lambda: _scene(plane, forces=(vector,)), r"Torque\(moment=\[0\. 0\. 2\.\]\) .* one number in the plane")
    _refused(lambda: _scene(flight, forces=(vector,)), r"Torque.* one number in the plane")
    _refused(lambda: jaxrod.Torque(jnp.ones(2)), r"Torque\(moment=\) has shape \(2,\)")
    _refused(lambda: _scene(flight, forces=(jaxrod.PivotFriction(0.1),)), r"PivotFriction needs a pivot.*Rotation\(\)")
    _refused(lambda: _scene(forces=(9.81,)), r"forces holds 9\.81.*give Torque, PivotFriction")


# ---- starts


@pytest.mark.parametrize("strain", [-1.0, -1.5])
def test_strain_inside_out(strain):
    _refused(lambda: _scene().state(strain=strain), rf"strain={strain:.6g} .* above -1")


def test_rigid_rods_do_not_stretch():
    rigid = _scene(basis=jaxrod.Ritz(0))
    _refused(lambda: rigid.state(strain=0.125), r"strain=0\.125.*Ritz\(0\) is rigid; take Ritz\(1\)")
    _refused(lambda: rigid.state(strain_rate=0.125), r"strain_rate=0\.125.*Ritz\(0\) is rigid")


@pytest.mark.parametrize(
    ("motion", "name", "value", "needed"),
    [
        (jaxrod.Rotation(), "azimuth", 0.5, "Spherical"),
        (jaxrod.Rotation(), "azimuth_rate", 0.5, "Spherical"),
        (jaxrod.Flight(), "azimuth", 0.5, "Spherical"),
        (jaxrod.Rotation(), "center", (0.0, 1.0), "Flight"),
        (jaxrod.Spherical(), "center", (0.0, 1.0), "Flight"),
        (jaxrod.Rotation(), "center_velocity", (0.0, 1.0), "Flight"),
    ],
)
def test_coordinates_of_another_motion(motion, name, value, needed):
    kind = type(motion).__name__
    shown = re.escape(f"{name}={value!r} has no meaning for {kind}()")
    _refused(lambda: _scene(motion).state(**{name: value}), shown + rf".*{needed}\(\)")


def test_centers():
    flight = _scene(jaxrod.Flight())
    _refused(lambda: flight.state(center=1.0), r"center has shape \(\) but must be an array of shape \(2,\)")
    _refused(lambda: flight.state(center=(1.0, 2.0, 3.0)), r"center has shape \(3,\)")
    _refused(lambda: flight.state(center=(1.0, math.nan)), r"center=\[ ?1\. nan\] is not finite")
    _refused(lambda: flight.state(center_velocity=(1.0, math.inf)), r"center_velocity=\[ ?1\. inf\] is not finite")


def test_no_azimuth_in_the_plane():
    state = _scene().state()
    for name in ("azimuth", "azimuth_rate"):
        with pytest.raises(AttributeError, match=f"{name} belongs to Spherical motion; .* angle and rate"):
            getattr(state, name)


# ---- runs


@pytest.mark.parametrize(
    ("times", "match"),
    [
        ({}, "neither of ts= and t1= given; give ts="),
        ({"ts": jnp.array([0.0, 1.0]), "t1": 1.0}, "both of ts= and t1= given; give ts="),
        ({"t1": 0.0}, "t1=0 does not lie after t0=0"),
        ({"t1": -1.0}, "t1=-1 does not lie after t0=0"),
        ({"t1": 1.0, "t0": 2.0}, "t1=1 does not lie after t0=2"),
        ({"ts": jnp.array([0.0, 0.2, 0.1])}, r"ts must increase, but ts\[1\]=0\.2 is followed by 0\.1; sort it"),
        ({"ts": jnp.array([0.0, 0.1, 0.1])}, r"ts\[1\]=0\.1 is followed by 0\.1; .*drop doubles"),
        ({"ts": jnp.array([-0.1, 0.1])}, r"ts=\[-0\.1 +0\.1\] does not lie after the start t0=0"),
        ({"ts": jnp.array([0.1, 0.2]), "t0": 0.15}, r"ts=\[0\.1 0\.2\] does not lie after the start t0=0\.15"),
        ({"ts": jnp.array([0.0])}, r"ts=\[0\.\] does not lie after the start t0=0"),
        ({"ts": jnp.array([0.0, math.nan])}, r"ts=\[ ?0\. nan\] is not finite"),
        ({"ts": jnp.zeros(0)}, r"ts has shape \(0,\)"),
        ({"ts": jnp.array([[0.0, 0.1]])}, r"ts has shape \(1, 2\)"),
        ({"ts": 0.5}, r"ts has shape \(\)"),
        ({"ts": "soon"}, "ts='soon' is not a number"),
        ({"ts": jnp.array([1.0]), "saveat": diffrax.SaveAt(t1=True)}, "saveat= goes with t1="),
        ({"t1": 1.0, "saveat": diffrax.SaveAt(dense=True)}, "saveat= goes with t1=, without dense="),
    ],
)
def test_times(times, match):
    _refused(lambda: _simulate(**times), match)


def test_tolerances():
    _refused(lambda: _simulate(t1=1.0, tolerance=1e-13), r"tolerance=1e-13 is beyond float64, which reaches 1e-12")
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (_scene(), _scene().state()))
    message = r"tolerance=1e-06 is beyond float32, which reaches 1e-05; .* are in float32"
    _refused(lambda: jaxrod.simulate(*single, t1=1.0, tolerance=1e-6), message)


@pytest.mark.parametrize(
    "steps",
    [
        {"solver": diffrax.Tsit5()},
        {"n_steps": 10},
        {"dt0": 0.1},
        {"stepsize_controller": diffrax.ConstantStepSize()},
    ],
)
def test_tolerance_and_steps_exclude_each_other(steps):
    (name,) = steps
    _refused(lambda: _simulate(t1=1.0, tolerance=1e-8, **steps), f"tolerance=1e-08 .*leave out {name}")


def test_steps():
    constant = diffrax.ConstantStepSize()
    _refused(lambda: _simulate(t1=1.0, n_steps=10, dt0=0.1), "n_steps=10 fixes the steps; leave out dt0=")
    _refused(lambda: _simulate(t1=1.0, n_steps=10, stepsize_controller=constant), "n_steps=10 fixes the steps")
    for n_steps in (0, -3, 2.5):
        _refused(lambda n=n_steps: _simulate(t1=1.0, n_steps=n), f"n_steps={n_steps} must be a positive whole number")
    _refused(lambda: _simulate(t1=1.0, solver=diffrax.Euler()), r"solver=Euler\(\) estimates no error.*give n_steps=")


def test_what_can_be_simulated():
    with pytest.raises(ValueError, match=r"system=Rod\((.|\n)*cannot be simulated; give a System, or Lagrangian"):
        jaxrod.simulate(_rod(), _scene().state(), t1=1.0)
    _refused(lambda: jaxrod.simulate(None, None, t1=1.0), r"system=None cannot be simulated")
    _refused(lambda: jaxrod.simulate(_scene(), None, t1=1.0), r"start=None does not fit; .*system\.state\(")
    _refused(lambda: jaxrod.simulate(_scene(), (0.0, 1.0), t1=1.0), r"start=\(0\.0, 1\.0\) .*state.*system\.state\(")


@pytest.mark.parametrize(
    ("start", "shapes"),
    [
        (lambda: eqx.filter_vmap(lambda rate: _scene().state(rate=rate))(jnp.ones(3)), r"\(3, 2\) .*\(3, 1\)"),
        (lambda: _scene(jaxrod.Spherical()).state(), r"\(3,\) .*\(1,\)"),
        (lambda: _scene(basis=jaxrod.Ritz(0)).state(), r"\(2,\) .*\(0,\)"),
    ],
)
def test_starts_of_another_scene(start, shapes):
    message = rf"start has director of shape {shapes}.*needs \(2,\) and \(1,\); make it by system\.state.*jax\.vmap"
    _refused(lambda: jaxrod.simulate(_scene(), start(), t1=1.0), message)


def test_a_start_without_center():
    flight = _scene(jaxrod.Flight())
    _refused(lambda: jaxrod.simulate(flight, _scene().state(), t1=1.0), "start has .* and a center; make it by")


def test_embedded_needs_a_strain():
    rigid = _scene(basis=jaxrod.Ritz(0))
    message = r"chart=Embedded\(\) needs one uniform strain and no tip_inertia; .*Director\(\)"
    _refused(lambda: _simulate(rigid, t1=1.0, chart=jaxrod.Embedded()), message)


# ---- many scenes, exact rod


@pytest.mark.parametrize(
    ("inputs", "shown"),
    [
        (3.0, r"'inputs': \(\)"),
        ((), ""),
        ((jnp.ones(3), jnp.ones(4)), r"'\[0\]': \(3,\), '\[1\]': \(4,\)"),
        ((jnp.ones(3), 1.0), r"'\[0\]': \(3,\), '\[1\]': \(\)"),
    ],
)
def test_sweep_needs_a_common_axis(inputs, shown):
    message = rf"inputs have shapes \{{{shown}\}}; give arrays of one common first axis"
    _refused(lambda: jaxrod.sweep(lambda x: x, inputs), message)


@pytest.mark.parametrize("block", [0, -3])
def test_sweep_needs_a_block(block):
    _refused(lambda: jaxrod.sweep(lambda x: x, jnp.ones(3), block=block), f"block={block} must be a positive whole")


def test_exact_frequencies_need_a_rod():
    _refused(lambda: jaxrod.continuum.natural_frequencies(_scene(rod=_lumped()), 2), r"rod=Lumped.*give a Rod")


# ---- other laws, driven rods, thick rods


@pytest.mark.parametrize(
    ("law", "match"),
    [
        (lambda e: e, r"law=<lambda> has W'\(0\) = 1 but must have 0"),
        (lambda e: e**2, r"law=<lambda> has W''\(0\) = 2 but must have 1"),
        (lambda e: jnp.sum(e**2 / 2), r"law=<lambda> returned an array of shape \(\); .* one energy .* for each"),
        (None, r"law=None is not a strain law"),
    ],
)
def test_strain_laws(law, match):
    _refused(lambda: _rod(law=law), match)


def test_critical_rate_is_of_hookes_law():
    stiffening = _scene(rod=_rod(law=jaxrod.law.green))
    _refused(lambda: jaxrod.critical_rate(stiffening), r"law=green stiffens or softens with strain")
    _refused(lambda: jaxrod.critical_rate(_scene(basis=jaxrod.Ritz(0))), r"Ritz\(0\) is rigid")


@pytest.mark.parametrize(
    ("angle", "gravity", "match"),
    [
        (lambda t: 50.0 * t, 9.81, r"turns at 50 rad/s under gravity"),
        (lambda t: 40.0 * t**2, None, r"faster and faster, by 80 rad/s\^2"),
    ],
)
def test_driven_rods_that_do_not_rest(angle, gravity, match):
    _refused(lambda: jaxrod.equilibrium(_scene(jaxrod.Driven(angle), gravity=gravity)), match)


def test_breaks():
    _refused(lambda: jaxrod.PiecewiseConstant(0.5, [1.0, 2.0]), r"breaks=0\.5 must be a sequence of numbers in m")
    _refused(lambda: jaxrod.PiecewiseConstant([float("nan")], [1.0, 2.0]), r"breaks=\(nan,\) must be finite")
    _refused(
        lambda: _rod(section=jaxrod.PiecewiseConstant([1.5], [1e-3, 2e-3])),
        r"breaks hold 1\.5 m, outside of 0 < s < length=1 m",
    )


def test_a_thick_rod_is_told():
    with pytest.warns(UserWarning, match=r"lateral inertia.* by 3 %; see jaxrod\.model_limits"):
        jaxrod.natural_frequencies(_scene(rod=_rod(section=jaxrod.Uniform(0.4))))


def test_questions_that_cannot_be_asked():
    """Of a plan, a trade-off and a horizon, before anything runs."""
    system = scene()
    start = system.state(rate=1.0)
    cases = [
        (lambda: jaxrod.plan(system, start, t1=-0.1, tolerance=1e-2), r"t1=-0.1 does not lie after t0=0"),
        (lambda: jaxrod.plan(system, start, t1="1", tolerance=1e-2), r"t1='1' is not a number"),
        (lambda: jaxrod.plan(system, None, t1=1.0, tolerance=1e-2), r"start=None does not fit"),
        (lambda: jaxrod.plan(system, start, t1=1.0, tolerance=float("nan")), r"tolerance=nan is not finite"),
        (lambda: jaxrod.tradeoff(system, start, t1=0.0), r"t1=0.* does not lie after t0=0"),
        (lambda: jaxrod.horizon(system, start, t1=1.0, tolerance=-1), r"tolerance=-1.* give it in lengths of the rod"),
        (lambda: jaxrod.horizon(system, start, t1=1.0, tolerance=1e-6, distance=0.0), r"distance=0.* rad and strain"),
    ]
    for call, said in cases:
        with pytest.raises(ValueError, match=said):
            call()
