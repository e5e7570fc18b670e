"""The exact rod in time, against closed forms, figures computed elsewhere and the strain bases.

The figures of release and spin are closed forms (d'Alembert's, of cones by a delay equation, 15 digits); those of the
rotor come from 80 exact modes with the tail of the series, good to the absolute errors given with them.
"""

import ast
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod
from jaxrod import continuum
from jaxrod.accuracy.ladder import on_rung
from jaxrod.continuum.simulation import by_first_modes

STILL = jaxrod.Driven(lambda t: 0.0 * t)


def unit(section, motion=None, basis=None, **others):
    """Length, modulus and density 1 unless given: time in travel times of a wave."""
    return scene(motion, basis, section=section, **({"young": 1.0, "density": 1.0} | others))


def off(got, want):
    return float(np.max(np.abs(np.asarray(got) - np.asarray(want))))


def triangle(tau):
    """Tip of a uniform rod let go from uniform strain, by its initial displacement: 1 - tau up to 2, period 4."""
    return np.abs(np.asarray(tau) % 4 - 2) - 1


# ---- figures computed elsewhere

ROTOR_TIMES = [0.1, 0.2, 0.4, 1.0]
ROTORS = {
    "sudden": (
        (jaxrod.Cone, (0.02, 0.03)), 0.0, False, (1.9e-11, 4.9e-11, 1.3e-12),
        [1.4042295121305546, 2.790558039250728, 5.805184814669766, 14.457649141356937],
        [14.084840410442396, 14.647016692553665, 15.235353134751161, 13.48391273094928],
        [-0.0017812876424927728, 0.0007832705203275298, 0.00535050843867347, 0.0173425328873797],
    ),
    "steady": (
        (jaxrod.Cone, (0.02, 0.03)), 0.0, True, (2.8e-11, 5.8e-11, 1e-12),
        [1.4478424658888425, 2.882628956210243, 5.981777350327791, 14.868441659013751],
        [14.148145581242375, 14.789632383769185, 15.25152935133889, 14.373445148645938],
        [0.010276529683895603, 0.011869513534946929, 0.013028668228677293, 0.010664193064416221],
    ),
    "uniform": (
        (jaxrod.Uniform, (0.025,)), -np.pi / 2, False, (6.6e-11, 9.6e-11, 1.1e-11),
        [-0.13164789835020876, 1.186100769076885, 3.834433448792139, 12.141564468387367],
        [13.713360209389398, 12.531206748021612, 14.330446813346146, 14.331494968698],
        [0.011473654942141904, 0.012462397879149689, 0.008604777851027446, 0.0019593789773436647],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ["sudden", *(pytest.param(x, marks=pytest.mark.slow) for x in ("steady", "uniform"))])
def test_rotor(name):
    """Figure 2 and its uniform rod, from rest and from the static stretch, to all digits that are known."""
    (section, radii), angle, static, known, *figures = ROTORS[name]
    system = scene(gravity=9.81, section=section(*radii))
    start = system.state(angle=angle, rate=15.0)
    sol = continuum.simulate(system, start, ts=jnp.array(ROTOR_TIMES), static=static, modes=128)
    errors = [off(got, want) for got, want in zip((sol.angle, sol.rate, sol.tip_stretch), figures, strict=True)]
    assert sol.ok and np.all(np.array(errors) < known), errors
    assert np.ptp(sol.energy) < 1e-11 * abs(sol.energy[0])


@pytest.mark.slow
def test_error_bounds_the_error():
    """Half the modes change more than what is wrong with all of them; the tip gains three powers of their number."""
    (section, radii), angle, _, _, *figures = ROTORS["uniform"]
    system = scene(gravity=9.81, section=section(*radii))
    start, tips = system.state(angle=angle, rate=15.0), []
    for modes in (8, 32):
        sol = continuum.simulate(system, start, ts=jnp.array(ROTOR_TIMES), modes=modes)
        got = (sol.angle, sol.rate, sol.tip_stretch)
        for x, want, error in zip(got, figures, sol.error, strict=True):
            assert off(x, want) < float(error.max()) < 1e3 * off(x, want)
        tips.append(off(sol.tip_stretch, figures[2]))
    assert tips[1] < tips[0] / 4**2.5


SPIN = [  # radii, rate over the critical one, K, displacement of the tip, strain at the pivot, int A y^2 ds
    ((1.0, 1.0), 0.1, 0.15707963267948966, 0.008306663459730667, 0.01246512578800293, 1.0681822455889158),
    ((1.0, 1.0), 0.5, 0.7853981633974483, 0.2732395447351627, 0.41421356237309503, 1.850680302385842),
    ((2.0, 3.0), 0.1, 0.13241944495755026, 0.008117065646097587, 0.015872061685619054, 8.116829929639762),
    ((2.0, 3.0), 0.5, 0.6620972247877513, 0.26709831374461246, 0.5278551594005806, 14.012579348045287),
    ((3.0, 2.0), 0.9, 1.6529374828369132, 3.55275375994856, 4.471808622383762, 146.86184781615043),
    ((1.0, 5.0), 0.5, 0.3796538445153158, 0.2558919291008155, 1.3841374847356887, 30.289150041119992),
]


@pytest.mark.parametrize(("radii", "fraction", "rate", "tip", "strain", "inertia"), SPIN)
def test_steady_spin(radii, fraction, rate, tip, strain, inertia):
    """The static stretch stays as it is, in a prescribed spin and in a free one."""
    ts = jnp.array([1.0, 5.0])
    for motion in (jaxrod.Driven(lambda t: rate * t), jaxrod.Rotation()):
        system = unit(jaxrod.Cone(*radii), motion)
        start = system.state() if isinstance(motion, jaxrod.Driven) else system.state(rate=rate)
        sol = continuum.simulate(system, start, ts=ts, static=True, modes=32, error=False)
        np.testing.assert_allclose(sol.tip_stretch, tip, rtol=1e-8)
        np.testing.assert_allclose(sol.strain_field([0.0]), strain, rtol=1e-5)
        np.testing.assert_allclose(sol.angular_momentum, rate * inertia, rtol=1e-8)
        np.testing.assert_allclose(sol.rate, rate, rtol=1e-8)
        assert off(sol.strain_field([1.0]), 0.0) < 1e-12 * strain


@pytest.mark.slow
def test_static_tip_is_the_steady_spin():
    system = unit(jaxrod.Cone(2.0, 3.0), jaxrod.Rotation(0.3), tip_mass=1.5)
    sol = continuum.simulate(system, system.state(rate=0.4), ts=jnp.array([1.0]), static=True)
    np.testing.assert_allclose(sol.tip_stretch, continuum.steady_spin(system, 0.4), rtol=1e-10)


TAUS = [0.3, 0.5, 1.0, 1.7, 2.6, 3.3, 7.25, 10.7, 20.2, 40.0]
RELEASE = {  # radii: tip over its initial displacement; int A s u ds over the initial strain
    (1.0, 1.0): (
        [0.7, 0.5, 0.0, -0.7, -0.4, 0.3, 0.25, -0.3, 0.8, 1.0],
        [0.9199630487262112, 0.719948316447661, 0.0, -0.9199630487262112, -0.5948082090796675, 0.4571017310973149,
         0.38451785083000073, -0.4571017310973149, 0.9885544883295883, 1.0471975511965979],
    ),
    (2.0, 3.0): (
        [0.7155127542269428, 0.5440812385969379, 0.1868372752582686, -0.4664801973396399, -0.6703723081012619,
         -0.3450413219797724, -0.8266628251571871, 0.050770183393992634, 0.06731288718403804, -0.7788562384808958],
        [7.184836302555807, 6.014046089811511, 1.8864822886452992, -4.882356471501592, -7.282118135190449,
         -2.753002505207799, -7.744861207486383, -0.11737012805917657, -0.199681382041964, -7.192482362894737],
    ),
    (3.0, 2.0): (
        [0.6785840471498844, 0.44239843385719024, -0.21306131942526685, -0.8173251461477459, 0.10749473114420023,
         0.7616334676575451, 0.5642549004969585, 0.5703116802238744, 0.5606725012597483, -0.3328665772154982],
        [4.512058270062262, 3.191465253857942, -1.3895718082793462, -5.302083266307373, 0.36017325506345166,
         5.1443290829668955, 3.8586141177594464, 3.6864243711034326, 4.335022771832276, -1.9072753540389187],
    ),
    (1.0, 5.0): (
        [0.7390614379017558, 0.6147808720515879, 0.5319261606155845, 0.2668791257635128, -0.20615774567850487,
         -0.6977201833144263, 0.5695587315632248, -0.22547853596102369, -0.8025288223060998, 0.4688591540829918],
        [16.273226111424652, 14.903855290384005, 11.896265704399706, 4.723126324306422, -5.971190366850075,
         -13.874409150145329, 11.8891353237483, -4.537365058040886, -16.06227668507883, 8.885615543073179],
    ),
}  # fmt: skip


@pytest.mark.parametrize("radii", [x if x == (2.0, 3.0) else pytest.param(x, marks=pytest.mark.slow) for x in RELEASE])
def test_release(radii):
    """Kinks keep the tip to 0.2 / modes; what is integrated over the rod has digits."""
    tip, moment = RELEASE[radii]
    system = unit(jaxrod.Cone(*radii), STILL)
    sol = continuum.simulate(
        system, system.state(strain=1.0), ts=jnp.array(TAUS), modes=64, tolerance=1e-10, error=False
    )
    assert off(sol.tip_stretch, tip) < 0.21 / 64
    assert off(sol.states.amplitudes @ sol.waves.lever, moment) < 1e-6 * max(np.abs(moment))
    # the series of as many terms is the same thing, found otherwise
    assert off(sol.tip_stretch, continuum.release(unit(jaxrod.Cone(*radii)), 1.0, jnp.array(TAUS), n=64)) < 1e-5
    assert off(continuum.release(unit(jaxrod.Cone(*radii)), 1.0, jnp.array(TAUS), n=400), tip) < 0.21 / 400


@pytest.mark.slow
@pytest.mark.parametrize("radii", [(1.0, 1.0), (2.0, 3.0)])
def test_release_goes_on_converging(radii):
    """Sixteen times the modes, sixteen times nearer to the closed form, at its kinks and between them."""
    system, tip, errors = unit(jaxrod.Cone(*radii), STILL), RELEASE[radii][0], []
    for modes in (32, 512):
        sol = continuum.simulate(system, system.state(strain=1.0), ts=jnp.array(TAUS), modes=modes, tolerance=1e-11)
        errors.append(off(sol.tip_stretch, tip))
    assert errors[1] < errors[0] / 8


# ---- closed forms


@pytest.mark.slow
def test_release_of_a_uniform_rod():
    """d'Alembert's triangle: the error halves as the modes double, no more, and the estimate says so."""
    ts, errors = jnp.linspace(0.1, 8.0, 80), []
    system = unit(jaxrod.Uniform(0.3), STILL)
    for modes in (16, 32, 64):
        sol = continuum.simulate(system, system.state(strain=0.01), ts=ts, modes=modes, tolerance=1e-11)
        errors.append(off(sol.tip_stretch / 0.01, triangle(ts)))
        assert errors[-1] < 0.21 / modes and errors[-1] < 1.01 * float(sol.error.tip.max()) / 0.01 + 1e-6
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2.0, rtol=0.02)


def test_step_load():
    """A force suddenly at the tip stretches it to twice the static displacement, and back to none."""
    ts, area = jnp.linspace(0.1, 8.0, 80), np.pi * 0.3**2
    system = unit(jaxrod.Uniform(0.3), forces=[jaxrod.TipForce(0.01 * area)])
    sol = continuum.simulate(system, system.state(), ts=ts, modes=64, tolerance=1e-11)
    static = 0.01
    assert off(sol.tip_stretch / static, 1 - triangle(ts)) < 0.21 / 64
    assert abs(float(sol.tip_stretch.max()) / static - 2) < 0.21 / 64
    still = continuum.simulate(system, system.state(), ts=ts, modes=64, tolerance=1e-11, static=True)
    np.testing.assert_allclose(still.tip_stretch, static, rtol=1e-12)
    np.testing.assert_allclose(still.strain_field([0.0, 0.4, 1.0]), 0.01, rtol=1e-12)
    # as many vibrations as the strain has, by the power of the force: T + V - F u stays
    work = 0.01 * area * (sol.states.amplitudes @ sol.waves.tip)
    assert np.ptp(sol.energy - work) < 1e-6 * float(work.max())


@pytest.mark.slow
def test_slow_load():
    """A force that grows over hundreds of periods is followed as if at rest."""
    area = np.pi * 0.3**2
    pull = jaxrod.TipForce(lambda t, state: 0.01 * area * jnp.sin(t * jnp.pi / 800) ** 2)
    system = unit(jaxrod.Uniform(0.3), forces=[pull])
    ts = jnp.linspace(100.0, 400.0, 4)
    sol = continuum.simulate(system, system.state(), ts=ts, modes=8, tolerance=1e-9)
    assert off(sol.tip_stretch, 0.01 * np.sin(np.asarray(ts) * np.pi / 800) ** 2) < 1e-6


@pytest.mark.slow
def test_flight_and_middle_pivot_are_two_halves():
    """A uniform rod in flight, or held in the middle, turns and stretches as one of half its length held at the root."""
    ts = jnp.array([0.5, 1.0, 3.0])
    half = unit(jaxrod.Uniform(0.3), length=0.5)
    want = continuum.simulate(half, half.state(angle=0.2, rate=1.5, strain=0.02), ts=ts, modes=32)
    for motion, gravity in ((jaxrod.Flight(), 3.0), (jaxrod.Rotation(0.5), None)):
        whole = unit(jaxrod.Uniform(0.3), motion, gravity=gravity)
        place = {"center": (1.0, 2.0), "center_velocity": (0.5, 4.0)} if gravity else {}
        start = whole.state(angle=0.2, rate=1.5, strain=0.02, **place)
        sol = continuum.simulate(whole, start, ts=ts, modes=64)
        assert off(sol.angle, want.angle) < 1e-8 and off(sol.rate, want.rate) < 1e-8
        assert off(sol.tip_stretch, want.tip_stretch) < 1e-8
        assert np.ptp(sol.angular_momentum) < 1e-11 * abs(sol.angular_momentum[0])
        assert np.ptp(sol.energy) < 1e-9 * abs(sol.energy[0])
        if gravity:
            t = np.asarray(ts)
            thrown = np.stack([1.0 + 0.5 * t, 2.0 + 4.0 * t - 3.0 * t**2 / 2], axis=1)
            assert off(sol.center, thrown) < 1e-11
            along = (sol.tip - sol.center) @ jnp.array([1.0, 0.0]) / jnp.cos(sol.angle)
            assert off(along, 0.5 + want.tip_stretch) < 1e-8


def test_flight_keeps_what_it_must():
    """Energy, angular momentum and the parabola of the centre of mass, of a cone that turns."""
    system, ts = unit(jaxrod.Cone(2.0, 3.0), jaxrod.Flight(), gravity=3.0), jnp.array([0.5, 1.0, 3.0])
    start = system.state(angle=0.2, rate=1.5, strain=0.02, center=(1.0, 2.0), center_velocity=(0.5, 4.0))
    sol = continuum.simulate(system, start, ts=ts, modes=16, error=False)
    t = np.asarray(ts)
    assert off(sol.center, np.stack([1.0 + 0.5 * t, 2.0 + 4.0 * t - 3.0 * t**2 / 2], axis=1)) < 1e-11
    assert np.ptp(sol.angular_momentum) < 1e-12 * abs(sol.angular_momentum[0])
    assert np.ptp(sol.energy) < 1e-9 * abs(sol.energy[0])
    turning = float(jnp.ptp(sol.rate))
    assert turning > 0.01  # it stretches, and that slows the turning


@pytest.mark.slow
def test_free_free_release():
    """Free at both ends and not turning: each half of the rod is let go by itself."""
    system, ts = unit(jaxrod.Uniform(0.3), jaxrod.Flight()), jnp.linspace(0.1, 4.0, 40)
    sol = continuum.simulate(system, system.state(strain=0.01), ts=ts, modes=64, tolerance=1e-11)
    assert off(sol.tip_stretch / 0.005, triangle(2 * np.asarray(ts))) < 0.21 / 32


# ---- in space


def test_spherical_is_rotation_for_a_planar_start():
    ts, plane, space = jnp.linspace(0.05, 0.3, 6), scene(gravity=9.81), scene(jaxrod.Spherical(), gravity=9.81)
    flat = continuum.simulate(plane, plane.state(angle=0.3, rate=9.0, strain=0.01), ts=ts, modes=16, error=False)
    sol = continuum.simulate(
        space, space.state(angle=0.3, rate=9.0, azimuth=0.7, strain=0.01), ts=ts, modes=16, error=False
    )
    outward = np.array([np.cos(0.7), np.sin(0.7)])
    want = np.concatenate([np.cos(flat.angle)[:, None] * outward[None, :], np.sin(flat.angle)[:, None]], axis=1)
    assert off(sol.director, want) < 1e-10  # through the pole
    assert off(sol.tip_stretch, flat.tip_stretch) < 1e-9 and off(sol.energy, flat.energy) < 1e-7


@pytest.mark.slow
def test_what_is_conserved_in_space():
    ts = jnp.linspace(0.1, 0.5, 5)
    for gravity in (None, 9.81):
        system = scene(jaxrod.Spherical(), gravity=gravity)
        start = system.state(angle=0.3, rate=6.0, azimuth=0.4, azimuth_rate=11.0, strain=0.02)
        sol = continuum.simulate(system, start, ts=ts, modes=32)
        momentum = np.asarray(sol.angular_momentum)
        kept = momentum if gravity is None else momentum[:, 2]
        assert np.max(np.ptp(kept, axis=0)) < 1e-11 * np.abs(momentum).max()
        assert gravity is None or np.ptp(momentum, axis=0).max() > 0.1
        assert np.ptp(sol.energy) < 1e-7 * abs(sol.energy[0])
        assert off(np.sum(np.asarray(sol.director) ** 2, axis=1), 1.0) < 1e-11
        assert sol.azimuth[-1] > 4.0


# ---- against the strain bases


def compared(system, start, ts, modes=48, **options):
    """Angle, rate and tip of the exact rod less those of the system's own basis."""
    sol = continuum.simulate(system, start, ts=ts, modes=modes, tolerance=1e-11, error=False)
    rung = jaxrod.simulate(system, start, ts=ts, tolerance=1e-10, **options)
    assert sol.ok and rung.ok
    return [off(getattr(sol, name), getattr(rung, name)) for name in ("angle", "rate", "tip")]


STEPPED = jaxrod.PiecewiseConstant([0.4], [2e-3, 1e-3])


@pytest.mark.slow
def test_breaks_pivot_and_tip_body():
    """All at once: a step in area, another in modulus, a pivot inside, a body at the tip with inertia, gravity."""
    young = jaxrod.PiecewiseConstant([0.7], [1e7, 3e7])
    numbers = {"section": STEPPED, "young": young, "tip_mass": 0.5, "tip_inertia": 0.01}
    system = scene(jaxrod.Rotation(0.15), jaxrod.Ritz(12), gravity=9.81, **numbers)
    angle, rate, tip = compared(system, system.state(angle=0.3, rate=10.0, strain=0.001), jnp.array([0.05, 0.1]))
    assert angle < 2e-7 and rate < 1e-3 and tip < 2e-5


@pytest.mark.slow
def test_tip_force_in_space():
    """One that keeps its direction, growing: it turns the rod, stretches it and pulls it along."""
    for motion in (jaxrod.Rotation(), jaxrod.Flight()):
        pull = jaxrod.TipForce(lambda t, state: jnp.array([30.0, 40.0]) * jnp.sin(20 * t) ** 3 * (1 + state.strain))
        system = scene(motion, jaxrod.ForceRitz(8), 9.81, (pull,))
        angle, rate, tip = compared(system, system.state(rate=3.0), jnp.array([0.05, 0.1]))
        assert angle < 1e-6 and rate < 1e-4 and tip < 1e-6


@pytest.mark.slow
def test_other_strain_laws():
    system = scene(basis=jaxrod.Ritz(8), gravity=9.81, law=jaxrod.law.neo_hookean)
    ts = jnp.array([0.05, 0.1])
    angle, rate, tip = compared(system, system.state(rate=15.0), ts, modes=24)
    assert angle < 2e-6 and rate < 1e-3 and tip < 1e-4
    sol = continuum.simulate(system, system.state(rate=15.0), ts=ts, modes=24, error=False)
    assert np.ptp(sol.energy) < 1e-9 * abs(sol.energy[0])
    hooke = scene(gravity=9.81)
    linear = continuum.simulate(hooke, hooke.state(rate=15.0), ts=ts, modes=24, error=False)
    assert off(sol.tip_stretch, linear.tip_stretch) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("motion", [jaxrod.Flight(), jaxrod.Rotation(pivot=0.3)], ids=lambda x: type(x).__name__)
def test_elongation(motion):
    """Strain is the elongation of the whole rod over its length, wherever the rod is held: the mean of its field."""
    system = unit(jaxrod.Cone(2.0, 3.0), motion, jaxrod.Ritz(3))
    start = system.state(rate=0.3)
    sol = continuum.simulate(system, start, ts=jnp.linspace(0.5, 1.5, 3), modes=64, error=False)
    x, w = (np.array(each) for each in np.polynomial.legendre.leggauss(200))
    nodes = np.concatenate([0.3 * (1 + x) / 2, 0.3 + 0.7 * (1 + x) / 2])  # from the pivot on strain jumps
    weights = np.concatenate([0.3 * w / 2, 0.7 * w / 2])
    np.testing.assert_allclose(sol.strain, sol.strain_field(nodes) @ weights, rtol=1e-6)
    near = jaxrod.simulate(*on_rung(system, start, jaxrod.LoadRitz(9)), ts=sol.ts)
    np.testing.assert_allclose(sol.strain, near.strain, rtol=1e-2)
    np.testing.assert_allclose(near.strain_field(nodes) @ weights, near.strain, rtol=1e-10)


@pytest.mark.slow
def test_strain_of_the_start():
    """The field of the basis, its rates too, and none of a rigid rod."""
    s = jnp.array([0.1, 0.5, 0.8])
    system = unit(jaxrod.Cone(2.0, 3.0), STILL, jaxrod.Ritz(3))
    start = system.state(amplitudes=[0.02, 0.01, -0.005], amplitude_rates=[0.0, 0.3, 0.1])
    sol = continuum.simulate(system, start, ts=jnp.array([0.0, 1e-3]), modes=256, error=False, tolerance=1e-10)
    assert off(sol.strain_field(s)[0], system.strain_field(start, s)) < 1e-4
    rates = np.asarray(sol.strain_field(s)[1] - sol.strain_field(s)[0]) / 1e-3
    faster = system.state(amplitudes=start.amplitude_rates)
    assert off(rates, system.strain_field(faster, s)) < 0.04
    rigid = unit(jaxrod.Cone(2.0, 3.0), STILL, jaxrod.Ritz(0))
    assert off(continuum.simulate(rigid, rigid.state(), ts=jnp.array([1.0]), modes=4).tip_stretch, 0.0) == 0.0


# ---- how it is called


@pytest.mark.slow
def test_converged():
    system = scene(gravity=9.81)
    start, ts = system.state(rate=15.0), jnp.array([0.05, 0.1])
    sol = continuum.converged(system, start, ts=ts, change=1e-9, quantity=lambda sol: sol.angle, modes=4)
    assert sol.waves.omega.size in (16, 32) and sol.error.angle.max() < 1e-9
    let_go = unit(jaxrod.Uniform(0.3), STILL)
    start, ts = let_go.state(strain=0.01), jnp.array([1.0, 2.0])
    with pytest.warns(UserWarning, match=r"16 modes still change the quantity by .* more than change=1e-08"):
        continuum.converged(let_go, start, ts=ts, change=1e-8, modes=4, most=16)


@pytest.mark.slow
def test_transformed(caplog):
    """Under jit and vmap; another rod, start and times of the same shapes are no new program."""
    ts = jnp.array([0.05, 0.1])

    def run(young, rate):
        system = scene(gravity=9.81, young=young)
        sol = continuum.simulate(system, system.state(rate=rate), ts=ts, modes=8, error=False)
        return sol.angle, sol.ok

    single, _ = run(1e7, 15.0)
    with jax.log_compiles(), caplog.at_level("WARNING"):
        run(2e7, 12.0)
    assert not [record for record in caplog.records if "Compiling _run" in record.getMessage()]
    assert off(jax.jit(run)(1e7, 15.0)[0], single) < 1e-10
    many, ok = jax.vmap(run)(jnp.array([1e7, 2e7]), jnp.array([15.0, 12.0]))
    assert off(many[0], single) < 1e-9 and ok.all()


def test_says_what_it_is():
    system = unit(jaxrod.Uniform(0.3))
    sol = continuum.simulate(system, system.state(rate=0.1), ts=jnp.array([1.0]), modes=4)
    assert "1 times to t = 1 s with 4 modes of the exact rod" in str(sol) and "half the modes change" in str(sol)
    silent = continuum.simulate(system, system.state(rate=0.1), ts=jnp.array([1.0]), modes=4, error=False)
    assert silent.error is None and "half" not in str(silent)


@pytest.mark.slow
def test_pressed_to_nothing():
    """Let go fast inwards the strain passes -1: the run goes on, and is not ok."""
    system = unit(jaxrod.Uniform(0.3), STILL)
    sol = continuum.simulate(system, system.state(strain_rate=-3.0), ts=jnp.array([0.2, 0.5]), modes=8)
    assert sol.ended and not sol.ok


def test_refusals():
    uniform = jaxrod.Uniform(0.025)
    system = scene(section=uniform)
    start, ts = system.state(rate=15.0), jnp.array([0.1])

    def refused(message, system=system, start=start, ts=ts, **options):
        with pytest.raises(ValueError, match=message):
            continuum.simulate(system, start, ts=ts, **options)

    lumped = scene(rod=jaxrod.Lumped(1.0, 1.0, 1.0, 1.0))
    refused(r"rod=Lumped.*give a Rod", lumped, lumped.state())
    for force in (jaxrod.Torque(1.0), jaxrod.PivotFriction(1.0), jaxrod.KelvinVoigt(1e-3)):
        refused(f"forces holds {type(force).__name__}.*leave it out", unit(uniform, forces=(force,)))
    refused("2 of TipForce.*their sum", unit(uniform, forces=[jaxrod.TipForce(1.0)] * 2))
    for modes in (1, 2.5, True):
        refused(f"modes={modes} must be a whole number", modes=modes)
    refused("tolerance=0 must be positive", tolerance=0.0)
    refused("tolerance=1e-17 is beyond float64", tolerance=1e-17)
    refused("ts=.*must increase", ts=jnp.array([0.2, 0.1]))
    refused("start=3 is not a state", start=3)
    flying = scene(jaxrod.Flight(), section=uniform)
    refused("start has director", start=flying.state())
    refused("critical rate of 143.393 rad/s", start=system.state(rate=150.0), static=True)
    refused("static=True is of Hooke's law", unit(uniform, law=jaxrod.law.green), static=True)
    f = jnp.float32
    single = scene(length=f(1.0), section=jaxrod.Uniform(f(0.025)), young=f(1e7), density=f(1200.0))
    refused("are float32; the exact rod needs float64", single, single.state(rate=f(1.0)))
    with pytest.raises(ValueError, match="most=16 leaves nothing to compare"):
        continuum.converged(system, start, ts=ts, change=1e-3, most=16)
    with pytest.raises(ValueError, match=r"change=-1.* must be positive"):
        continuum.converged(system, start, ts=ts, change=-1.0)


def test_shares_nothing_with_the_rungs():
    """The yardstick reads the rod, its motion and the force at its tip, quadrature; no shapes, energies, equations.

    When loads change it knows from the same look at them as any run.
    """
    of_ours = set()
    for path in pathlib.Path(continuum.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == 2:
                of_ours |= {f"{node.module}.{x.name}" if node.module else f"{x.name}." for x in node.names}
    assert {name.split(".")[0] for name in of_ours} == {"core", "integrators", "rods", "motions"}
    rooms = {name.rsplit(".", 1)[0] for name in of_ours}
    assert {name for name in rooms if name.startswith("integrators")} == {"integrators.reversal"}
    assert [name for name in of_ours if name.startswith("motions.force.")] == ["motions.force.TipForce"]


def test_pressed_to_nothing_between_the_times():
    """Set to three times the critical rate at once, a section is pressed through itself on the way back: at the end, when all is
    stretched again, it is not forgotten."""
    system = scene()
    start = system.state(rate=3 * jaxrod.continuum.critical_rate(system))
    for ts, ok in ((jnp.array([0.05]), True), (jnp.array([0.1]), False)):
        assert bool(jaxrod.continuum.simulate(system, start, ts=ts, modes=32, error=False).ok) == ok


def test_first_modes_in_larger_arrays(scene):
    """As a run of so many modes by itself: what stands behind them carries nothing."""
    system = scene(gravity=9.81)
    start, ts = system.state(rate=12.0, strain=0.02), jnp.array([0.05, 0.1])
    alone = jaxrod.continuum.simulate(system, start, ts=ts, modes=6, error=False)
    padded = by_first_modes(6, system, start, ts=ts, modes=12, error=False)
    whole = by_first_modes(12, system, start, ts=ts, modes=12, error=False)
    np.testing.assert_allclose(padded.tip, alone.tip, atol=1e-10)
    np.testing.assert_allclose(padded.strain, alone.strain, atol=1e-9)
    np.testing.assert_allclose(padded.angle, alone.angle, atol=1e-10)
    assert np.max(np.abs(whole.tip - alone.tip)) > 1e-6
