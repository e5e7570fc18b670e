"""Quantities with units, numbers of no solid, and the float type of a scene: nothing is stripped or lowered in silence."""

import functools
import subprocess
import sys
import types

import jax
import jax.numpy as jnp
import numpy as np
import pint
import pytest
from conftest import make_rod, scene

import jaxrod
from jaxrod.core import units

Q = pint.UnitRegistry().Quantity  # one of its own, not the application's


_steel = functools.partial(make_rod, length=2.0, section=jaxrod.Uniform(0.01), young=2e11, density=7850.0)
_scene = functools.partial(scene, rod=_steel())


# ---- quantities are converted


def test_a_scene_in_mixed_units_is_that_in_si():
    """Every number of a scene with its unit, against the same in SI: the run is the same to the last digits."""
    section = jaxrod.Cone(Q(20, "mm"), Q(3, "cm"))
    rod = jaxrod.Rod(Q(2000, "mm"), section, Q(200, "GPa"), Q(7.85, "g/cm^3"), Q(0.5, "lb"), Q(2, "kg*cm^2"))
    forces = [
        jaxrod.Torque(Q(1.5, "N cm")),
        jaxrod.TipForce(Q(2, "kN")),
        jaxrod.PivotFriction(Q(3, "mN m s")),
        jaxrod.KelvinVoigt(Q(2, "us")),
    ]
    with_units = jaxrod.System(rod, jaxrod.Rotation(Q(10, "cm")), gravity=Q(1, "g_0"), forces=forces)
    start = with_units.state(angle=Q(-90, "deg"), rate=Q(60, "rpm"), strain=Q(0.1, "percent"), strain_rate=Q(3, "1/ms"))
    assert float(rod.young) == 2e11 and float(rod.length) == 2.0
    plain_rod = jaxrod.Rod(2.0, jaxrod.Cone(0.02, 0.03), 2e11, 7850.0, 0.5 * 0.45359237, 2e-4)
    forces = [jaxrod.Torque(0.015), jaxrod.TipForce(2e3), jaxrod.PivotFriction(3e-3), jaxrod.KelvinVoigt(2e-6)]
    plain = jaxrod.System(plain_rod, jaxrod.Rotation(0.1), gravity=9.80665, forces=forces)
    same = plain.state(angle=-np.pi / 2, rate=2 * np.pi, strain=1e-3, strain_rate=3e3)
    for got, right in ((with_units, plain), (start, same)):
        for x, y in zip(jax.tree.leaves(got), jax.tree.leaves(right), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-14, atol=1e-15)


def test_times_and_steps():
    system = _scene(basis=jaxrod.Ritz(0), gravity=[0.0, Q(-981, "cm/s^2")])
    start = system.state(angle=Q(0.25, "turn"))
    plain = jaxrod.simulate(system, start, ts=jnp.array([0.1, 0.2]), t0=0.05)
    for ts in (
        Q([100.0, 200.0], "ms"),
        [Q(100, "ms"), Q(0.2, "s")],
        np.array([Q(100, "ms"), Q(0.2, "s")], dtype=object),
    ):
        got = jaxrod.simulate(system, start, ts=ts, t0=Q(50, "ms"))
        np.testing.assert_allclose(got.ts, plain.ts, rtol=1e-15)
        np.testing.assert_allclose(got.angle, plain.angle, rtol=1e-13)
    end = jaxrod.simulate(system, start, t1=Q(200, "ms"), dt0=Q(1, "ms"))
    assert float(end.ts[0]) == 0.2 and int(end.stats["num_steps"]) == 200
    place = plain.shape(Q([0.0, 200.0], "cm"))
    np.testing.assert_allclose(place[:, 1], plain.tip, rtol=1e-14)


def test_profiles_and_bodies():
    table = jaxrod.Table(Q([0, 500, 2000], "mm"), radii=[Q(2, "cm"), Q(21, "mm"), 0.02])
    np.testing.assert_allclose(table.positions, [0.0, 0.5, 2.0])
    np.testing.assert_allclose(table.areas, np.pi * np.array([0.02, 0.021, 0.02]) ** 2)
    assert float(jaxrod.Table([0.0, 1.0], areas=Q([1, 2], "cm^2")).areas[1]) == pytest.approx(2e-4)
    rod = _steel(young=jaxrod.PiecewiseConstant(Q([40], "cm"), [2e11, 1e11]), section=table)
    assert rod.breaks == (0.4,)
    body = jaxrod.Lumped(Q(100, "kg cm^2"), Q(100, "g m"), Q(330, "N mm"), Q(10, "cm"))
    np.testing.assert_allclose(jax.tree.leaves(body), [0.01, 0.1, 0.33, 0.1])
    flying = _scene(jaxrod.Flight())
    state = flying.state(center=Q([1, 2], "km"), center_velocity=[Q(36, "km/h"), 0.0])
    np.testing.assert_allclose(state.center, [1000.0, 2000.0])
    np.testing.assert_allclose(state.center_velocity, [10.0, 0.0])


def test_under_transformations():
    """A traced magnitude is converted, too."""

    def mass(length):
        return _steel(length=Q(length, "mm")).mass

    np.testing.assert_allclose(jax.jit(mass)(2000.0), _steel().mass)
    np.testing.assert_allclose(jax.grad(mass)(2000.0), _steel().mass / 2000)


def test_parameters_of_a_fit_are_in_si():
    start = {"young": jaxrod.Positive(Q(20, "MPa")), "angle": Q(10, "deg")}
    found = jaxrod.fit(lambda p: jnp.stack([p["young"] / 1e7, p["angle"]]), [1.0, 0.2], 0.1, start)
    assert float(found.parameters["young"]) == pytest.approx(1e7)
    for wrong in ({"data": Q([1.0, 0.2], "Hz")}, {"sigma": Q(0.1, "Hz")}, {"data": [Q(1, "Hz"), Q(2, "Hz")]}):
        with pytest.raises(ValueError, match=r"(data|sigma)=.* has a unit"):
            jaxrod.fit(**({"model": lambda p: p, "data": [1.0, 0.2], "sigma": 0.1, "start": start} | wrong))


# ---- or refused


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: _steel(length=Q(2, "kg")), r"length=2 kilogram does not convert to m; give a number in m"),
        (lambda: _steel(length=Q(20, "degC")), r"length=20 degree_Celsius does not convert to m"),
        (lambda: _steel(young=Q(7850, "kg/m^3")), r"young=7850 .* does not convert to Pa"),
        (lambda: jaxrod.Uniform(Q(1, "cm^2")), r"Uniform\(radius=\)=1 centimeter \*\* 2 does not convert to m"),
        (lambda: _scene().state(rate=Q(2, "Hz")), r"rate=2 hertz does not say of what; give turns as rpm"),
        (lambda: _scene().state(strain=Q(2, "deg")), r"strain=2 degree is an angle; give a number without a unit"),
        (lambda: _scene().state(strain=Q(2, "mm")), r"strain=2 millimeter does not convert to a number"),
        (lambda: _scene().state(angle=Q(2, "m")), r"angle=2 meter does not convert to rad"),
        (lambda: jaxrod.simulate(_scene(), _scene().state(), t1=Q(1, "m")), "t1=1 meter does not convert to s"),
        (lambda: jaxrod.simulate(_scene(), _scene().state(), ts=Q([1, 2], "m")), r"ts=\[1 2\] meter does not"),
        (lambda: jaxrod.simulate(_scene(), _scene().state(), t1=1.0, tolerance=Q(1, "mm")), "tolerance=1 millimeter"),
        (lambda: jaxrod.Torque(Q(1, "N")), r"Torque\(moment=\)=1 newton does not convert to N m"),
        (lambda: jaxrod.PiecewiseConstant(Q([1], "s"), [1.0, 2.0]), r"breaks=\[1\] second does not convert to m"),
        (lambda: jaxrod.equilibrium(_scene(), spin=Q(1, "m")), "spin=1 meter does not convert to rad/s"),
        (lambda: jaxrod.Rotation(Q(0, "s")), "pivot=0 second does not convert to m"),
        (lambda: jaxrod.Lumped(1.0, Q(1, "kg"), 1.0, 1.0), "first_moment=1 kilogram does not convert to kg m"),
        (lambda: _steel(young="210 GPa"), "young='210 GPa' is not a number; give a real number in Pa"),
    ],
)
def test_of_another_kind_they_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize(
    "build",
    [
        lambda: _steel(section=lambda s: Q(1e-4 + 0 * s, "m^2")),
        lambda: _steel(young=lambda s: Q(200.0, "GPa")),
        lambda: jaxrod.Driven(lambda t: Q(90.0, "deg")),
        lambda: _scene(forces=[jaxrod.Torque(lambda t, state: Q(1.0, "N mm"))]),
        lambda: _scene(forces=[jaxrod.ShakenBase(lambda t: Q(np.ones(2), "mm"))]),
        lambda: jaxrod.fit(lambda p: Q(np.ones(2), "mm"), [1.0, 1.0], 1.0, {"a": 1.0}),
    ],
    ids=["section", "young", "drive", "torque", "base", "model"],
)
def test_what_functions_return_is_refused(build):
    """JAX would strip its unit."""
    with pytest.raises(ValueError, match=r"(returned|gives) .*(Quantity|unit)"):
        build()


def test_records_and_impulses():
    record = jaxrod.Record(Q([0.0, 1000.0], "ms"), Q([0.0, 2.0], "mm"))
    np.testing.assert_allclose(record(0.5), 1e-3)
    blow = jaxrod.Impulse(Q(1, "N ms"), Q(1, "min"), Q(10, "us"))
    np.testing.assert_allclose([blow.total, blow.start, blow.width], [1e-3, 60.0, 1e-5])
    with pytest.raises(ValueError, match=r"Impulse\(width=\)=1 millimeter does not convert to s"):
        jaxrod.Impulse(1.0, 0.0, Q(1, "mm"))
    assert jaxrod.TipForce(jaxrod.Record([0.0, 1.0], Q([0.0, 2.0], "kN"))).force.samples[1] == 2000.0
    for wrong, message in (
        (
            lambda: jaxrod.Torque(jaxrod.Record([0.0, 1.0], Q([0.0, 2.0], "kN"))),
            r"Torque\(moment=\) is a Record in kilonewton",
        ),
        (
            lambda: jaxrod.Torque(jaxrod.Impulse(Q(1, "N"), 0.0, 1.0)),
            r"Torque\(moment=\) is an Impulse in newton.*N m s",
        ),
        (lambda: jaxrod.ShakenBase(acceleration=record), r"ShakenBase\(acceleration=\) is a Record in millimeter"),
        (lambda: jaxrod.Driven(record), r"Driven\(angle=\) is a Record in millimeter"),
    ):
        with pytest.raises(ValueError, match=message):
            wrong()


class _Foreign(np.ndarray):
    """As quantities of other packages are: an array with a unit, which NumPy takes for plain numbers."""

    unit = "mm"


_Foreign.__module__ = "astropy.units.quantity"


@pytest.mark.parametrize(
    "value",
    [
        np.asarray(2000.0).view(_Foreign),
        types.SimpleNamespace(unit="mm", value=2000.0),
        types.SimpleNamespace(dtype=types.SimpleNamespace(units="mm"), __array__=lambda: np.array(2000.0)),
        types.SimpleNamespace(data=Q(2000.0, "mm")),
    ],
    ids=["array", "object", "by its type", "inside"],
)
def test_quantities_of_other_packages_are_refused_by_name(value):
    with pytest.raises(ValueError, match=r"length=.* is a quantity of (astropy|types).*, or a quantity of Pint"):
        _steel(length=value)


# ---- texts


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("210 GPa", "Pa", 2.1e11),
        ("210GPa", "Pa", 2.1e11),
        ("7.8 g/cm^3", "kg/m^3", 7800.0),
        ("7.8 g/cm³", "kg/m^3", 7800.0),
        ("-90 deg", "rad", -np.pi / 2),
        ("90°", "rad", np.pi / 2),
        ("2 %", "", 0.02),
        ("0.02", "", 0.02),
        (" 1e-3  m ", "m", 1e-3),
        (".5 inch", "m", 0.0127),
        ("9.81 m s^-2", "m/s^2", 9.81),
        ("3 N·m", "N m", 3.0),
        ("60 rpm", "rad/s", 2 * np.pi),
        ("1e7 N/m**2", "Pa", 1e7),
        ("20 degC", "K", 293.15),
    ],
)
def test_read(text, unit, number):
    assert units.read(text, unit) == pytest.approx(number, rel=1e-14)


@pytest.mark.parametrize(
    "text", ["GPa", "", "soft", "1,5 m", "[1,2] m", "1 m; 2", "1 m + 2 m", "2 foo", "nan m", "1e3 kg", "3", "2*3 m"]
)
def test_read_refuses_what_pint_would_guess(text):
    """Pint reads '1,5 m' as 15 m."""
    with pytest.raises(ValueError, match=r"is not a number with a unit|does not convert to m"):
        units.read(text, "m")


# ---- numbers of no solid

SYSTEMS = {
    "mm, tonne, s": (1e-6, 1e-12),
    "mm, kg, ms": (1e-9, 1e-9),
    "mm, g, ms": (1e-6, 1e-6),
    "mm, kg, s": (1e-3, 1e-9),
    "mm, mg, s": (1e3, 1e-3),
    "m, tonne, s": (1e-3, 1e-3),
    "inch, pound, s": (1 / 6894.757, 1 / 1.068688e7),
    "foot, slug, s": (1 / 47.88026, 1 / 515.3788),
    "cgs": (10.0, 1e-3),
    "SI": (1.0, 1.0),
}
SOLIDS = {
    "steel": (2.1e11, 7850.0),
    "aluminium": (7e10, 2700.0),
    "titanium": (1.1e11, 4500.0),
    "tungsten": (4e11, 19300.0),
    "concrete": (3e10, 2400.0),
    "glass": (7e10, 2500.0),
    "carbon": (2.3e11, 1750.0),
    "nylon": (4e9, 1150.0),
    "rubber": (1e7, 1200.0),
}


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("solid", SOLIDS)
def test_solids_in_consistent_units_are_silent(solid, system):
    """The equations hold in any: inch-pound steel draws no alarm (warnings are errors here)."""
    (young, density), (stress, mass) = SOLIDS[solid], SYSTEMS[system]
    _steel(young=young * stress, density=density * mass)


@pytest.mark.parametrize(
    ("young", "density"),
    [
        (4e3, 1200.0),
        (1e3, 1000.0),
        (1.0, 1.0),
        (1.6e10, 11340.0),
        (1.2e12, 3510.0),
        (1e5, 30.0),
        (1e6, 3.0),
        (3e9, 150.0),
    ],
    ids=["jelly", "gel", "no units", "lead", "diamond", "foam", "aerogel", "balsa"],
)
def test_odd_but_real_ones_are_silent(young, density):
    _steel(young=young, density=density)


@pytest.mark.parametrize(
    ("young", "density", "named"),
    [
        (2.1e11, 7.8, r"density in g/cm\^3 \(give 7800\)"),
        (7e10, 2.7, r"density in g/cm\^3 \(give 2700\)"),
        (1.5e11, 1.6, r"density in g/cm\^3 \(give 1600\)"),
        (210.0, 7800.0, r"young in GPa \(give 2.1e\+11\)"),
        (70.0, 2700.0, "young in GPa"),
        (2.1e5, 7800.0, r"young in MPa \(give 2.1e\+11\)"),
        (7e4, 2700.0, "young in MPa"),
        (10.0, 1200.0, "young in MPa"),
        (2.5, 1150.0, "young in GPa"),
        (2.1e8, 7800.0, "young in kPa"),
        (30e6, 7800.0, "young in psi"),
        (30e6, 0.284, r"young in psi .* and density in lb/in\^3 \(give 7861\)"),
        (2.1e5, 7.8e-6, r"young in MPa .* and density in kg/mm\^3"),
        (2.1e11, 7.8e-9, r"density in t/mm\^3"),
        (2.1e12, 7800.0, r"young in dyn/cm\^2"),
        (1e13, 1200.0, r"10\^7 MPa where 10\^7 Pa is meant"),
    ],
)
def test_a_slip_is_named(young, density, named):
    with pytest.warns(UserWarning, match=rf"wave speed .* is young=.* in Pa and density=.* in kg/m\^3\?.*{named}"):
        _steel(young=young, density=density)


def test_numbers_at_the_ends_of_their_type():
    """They overflow nowhere on the way to a question."""
    for young, density in ((1e300, 1e-300), (1e-300, 1e4)):
        with pytest.warns(UserWarning, match="wave speed"):
            _steel(young=young, density=density)


def test_a_slip_in_a_part_of_the_rod():
    with pytest.warns(UserWarning, match="beyond any solid"):
        _steel(
            young=jaxrod.PiecewiseConstant([0.5], [2e11, 2e14]),
            density=jaxrod.PiecewiseConstant([0.5], [7800.0, 7800.0]),
        )


def test_inches_are_right():
    """Steel in inch, pound, second: pi c / 2 L of a rod held at its root."""
    system = scene(length=60.0, section=lambda s: 1.0 + 0 * s, young=30e6, density=7.3e-4)
    got = 2 * np.pi * jaxrod.continuum.natural_frequencies(system, 1)
    np.testing.assert_allclose(got, np.pi / 120 * np.sqrt(30e6 / 7.3e-4), rtol=1e-12)


def test_millimetres_are_weighed():
    with pytest.warns(UserWarning, match=r"the rod weighs 4.9e\+09 kg: .* length=2000 .* in m\? In mm .* 4.9 kg"):
        _steel(length=2000.0, section=jaxrod.Uniform(10.0), density=7800.0)
    _steel(length=120.0, section=jaxrod.Uniform(1.1))  # a monopile at sea: 3,600 t
    jaxrod.Rod(1e8, jaxrod.Uniform(0.05), 5e11, 1300.0)  # a tether to beyond the geostationary orbit
    _steel(length=1e6, section=jaxrod.Uniform(2.0))


@pytest.mark.parametrize("name", ["angle", "azimuth"])
def test_degrees_are_asked_about(name):
    system = _scene(jaxrod.Spherical())
    with pytest.warns(UserWarning, match=rf"{name}=90 rad is 14.3 turns; .* give {name}=jnp.deg2rad\(90\)"):
        system.state(**{name: 90})
    for fine in (5.0, 3 * np.pi, 20 * np.pi, 12.0, -7.5, Q(90, "deg")):
        system.state(**{name: fine})


def test_a_strain_beyond_hookes_law_is_asked_about():
    with pytest.warns(UserWarning, match="of no solid of that density"):
        rod = make_rod(section=jaxrod.Uniform(0.025), young=200.0, density=7800.0)
    system = scene(gravity=9.81, rod=rod)
    with pytest.warns(UserWarning, match=r"the strain reaches \d\d.*Hooke's law: is young=200 in Pa"):
        jaxrod.simulate(system, system.state(), ts=jnp.linspace(0.1, 3.0, 30))


# ---- float32


def test_one_number_in_float32_is_named():
    system = scene(gravity=9.81, young=np.float32(1e7))
    start = system.state(rate=15.0)
    with pytest.warns(
        UserWarning, match=r"^rod.young is in float32, and so the run is; give Python numbers or float64"
    ):
        sol = jaxrod.simulate(system, start, t1=0.1)
    assert sol.angle.dtype == jnp.float32 and "steps in float32: the run" in str(sol)
    with pytest.raises(ValueError, match=r"the exact rod needs float64: rod.young is in float32, so give Python"):
        jaxrod.continuum.simulate(system, start, ts=jnp.array([0.1]))


def test_float32_in_a_sweep_and_in_frequencies_is_named():
    system = scene(gravity=9.81)
    with pytest.warns(UserWarning, match="^start is in float32"):
        found = jaxrod.sweep(
            lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=0.1).angle[-1], np.ones(2, np.float32)
        )
    assert found.dtype == jnp.float32
    for frequencies in (jaxrod.natural_frequencies, lambda system: jaxrod.continuum.natural_frequencies(system, 1)):
        with pytest.warns(UserWarning, match="^rod.young is in float32"):
            assert frequencies(scene(gravity=9.81, young=np.float32(1e7))).dtype == jnp.float32


def test_a_start_in_float32_is_named():
    system = scene(gravity=9.81)
    with pytest.warns(UserWarning, match="^start is in float32, and so the run is"):
        jaxrod.simulate(system, system.state(rate=np.float32(15.0)), t1=0.1)


def test_a_start_in_float64_raises_the_type():
    """As JAX promotes: no word is needed."""
    system, other = scene(gravity=9.81, young=np.float32(1e7)), scene(gravity=9.81)
    sol = jaxrod.simulate(system, other.state(rate=15.0), t1=0.1)
    assert sol.angle.dtype == jnp.float64 and "steps in float64: the run" in str(sol)


def test_float32_throughout_is_meant():
    system = scene(gravity=9.81)
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (system, system.state(rate=15.0)))
    assert jaxrod.simulate(*single, t1=0.1).angle.dtype == jnp.float32


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "printed", "advised"),
    [
        ("", "float32, as jaxrod.configure() was not called", "call jaxrod.configure() before anything else"),
        ("jaxrod.configure(x64=False, cache=None)", "float32", "leave x64=False out of jaxrod.configure()"),
    ],
)
def test_the_advice_fits_what_was_done(line, printed, advised):
    """In a process of its own, which did not configure JAX or asked for float32."""
    program = f"""
import jaxrod
{line}
scene = jaxrod.System(jaxrod.Rod(1.0, jaxrod.Uniform(0.02), 1e7, 1200.0), jaxrod.Rotation(), gravity=9.81)
print(jaxrod.simulate(scene, scene.state(rate=1.0), t1=0.1))
given = scene, scene.state()
for verb, how in ((jaxrod.continuum.simulate, {{"ts": [0.1]}}), (jaxrod.plan, {{"t1": 1.0, "tolerance": 1e-3}})):
    try:
        verb(*given, **how)
    except ValueError as error:
        print(error)
"""
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=True)
    assert f"steps in {printed}: the run" in found.stdout and found.stdout.count(advised) == 2
    said = "configure() was not called: numbers are float32, compiled programs are not kept for the next process"
    assert found.stderr.count(said) == (not line)  # once


def test_an_error_asked_over_times_with_units():
    """The runs that tell it, and the times that a quantity looks at, are in s too."""
    system = scene(gravity=9.81, section=jaxrod.Uniform(0.025))
    start, asked = system.state(rate=3.0), [jaxrod.FinalTip(), jaxrod.LargestStrain()]
    with_units = jaxrod.simulate(system, start, t0=Q(100, "ms"), t1=Q(150, "ms"), budget=asked).budget
    plain = jaxrod.simulate(system, start, t0=0.1, t1=0.15, budget=asked).budget
    for one, other in zip(with_units, plain, strict=True):
        np.testing.assert_array_equal(one.value, other.value)
        np.testing.assert_array_equal(one.bound, other.bound)
