"""Cases that others published: their number, and the right one where the two differ."""

import math

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
import scipy.interpolate
import scipy.special

import jaxrod

# ---- rigid pendulums


def pendulum(inertia, first_moment, gravity):
    """A rigid one; the stiffness is not used."""
    rod = jaxrod.Lumped(inertia, first_moment, stiffness=1.0, length=1.0)
    return jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(0), gravity=gravity)


def test_iftomm_simple_pendulum():
    """IFToMM library of computational benchmark problems, A01: 1 kg at 1 m, released horizontal, 10 s.

    Public codes keep the energy to 5e-5 J.
    """
    system = pendulum(1.0, 1.0, gravity=9.81)
    sol = jaxrod.simulate(system, system.state(angle=0.0, rate=0.0), ts=np.linspace(0, 10, 201))
    error = np.max(np.abs(sol.energy))  # zero at the start
    assert error < 5e-5
    assert error < 1e-9, "this library does far better"
    assert np.min(sol.angle) < -3.1, "it must swing through"


@pytest.mark.parametrize("k", [0.1, 0.7, 0.999])
def test_exact_pendulum(k):
    """SciMLBenchmarks, single_pendulums: q'' = -sin q, q(0) = 0, q'(0) = 2k has q(t) = 2 asin(k sn(t, k))."""
    system = pendulum(1.0, 1.0, gravity=1.0)
    ts = np.linspace(0, 40, 201)
    sol = jaxrod.simulate(system, system.state(angle=-math.pi / 2, rate=2 * k), ts=ts)
    sn, cn, dn, _ = scipy.special.ellipj(ts, k**2)
    np.testing.assert_allclose(sol.angle + math.pi / 2, 2 * np.arcsin(k * sn), rtol=0, atol=1e-8)
    np.testing.assert_allclose(sol.rate, 2 * k * cn, rtol=0, atol=1e-8)
    np.testing.assert_allclose(2 * dn**2 - 2 + 2 * k**2, sol.rate**2 / 2, rtol=0, atol=1e-8)


SDNL100 = {  # inertia, first moment, period in s
    "point mass at the middle": (1 / 4, 1 / 2, 1.674317),
    "uniform bar": (1 / 3, 1 / 2, 1.933335),
    "point mass at the tip": (1.0, 1.0, 2.367842),
}


def above_hanging(t, state, args, **_):
    return state.angle + math.pi / 2


@pytest.mark.parametrize("inertia, first_moment, period", SDNL100.values(), ids=SDNL100)
def test_code_aster_sdnl100(inertia, first_moment, period):
    """Code_Aster SDNL100, a heavy bar of 1 m and 1 kg/m, released horizontal: T = 1.6744 s in the manual.

    That is the period of a point mass at the middle of the bar; the bar it describes takes 1.933335 s.  The three
    bodies differ in inertia over first moment: l/2, 2l/3, l.
    """
    system = pendulum(inertia, first_moment, gravity=9.81)
    passes_below = diffrax.Event(above_hanging, optx.Newton(rtol=1e-12, atol=1e-12), direction=False)
    sol = jaxrod.simulate(system, system.state(), t1=2.0, event=passes_below)
    quarter = float(sol.stats["t_end"])
    exact = math.sqrt(inertia / (9.81 * first_moment)) * scipy.special.ellipk(0.5)
    assert quarter == pytest.approx(exact, rel=1e-9)
    assert 4 * quarter == pytest.approx(period, abs=5e-7)
    assert (abs(4 * quarter - 1.6744) < 1e-4) == (inertia == 1 / 4), "only the point mass at l/2 has the quoted period"


# ---- axial frequencies


CLAMPED_CONES = [  # r_tip / r_root, exact x = omega L sqrt(rho / E), x of the uniform strain, over by %
    (0.0, 3.141592654, 3.162277660, 0.658),
    (0.25, 2.455643863, 2.485250609, 1.206),
    (0.5, 2.028757838, 2.091650066, 3.100),
    (1.0, 1.570796327, 1.732050808, 10.266),
    (1.5, 1.324194450, 1.581138830, 19.404),
    (2.0, 1.165561185, 1.502685768, 28.924),
    (4.0, 0.844730843, 1.388022156, 64.315),
    (10.0, 0.542280885, 1.326315392, 144.581),
]


@jax.jit
def _clamped(q):
    rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(1.0, q), young=1.0, density=1.0)
    system = jaxrod.System(rod, jaxrod.Rotation())
    exact, uniform = jaxrod.continuum.natural_frequencies(system, 1)[0], jaxrod.natural_frequencies(system)[0]
    return 2 * np.pi * exact, 2 * np.pi * uniform, jaxrod.frequency_error(system)[0]


@pytest.mark.parametrize("q, exact, uniform, over", CLAMPED_CONES)
def test_clamped_cones(q, exact, uniform, over):
    """The paper's "about 10 %" belongs to the uniform rod alone."""
    got_exact, got_uniform, got_over = _clamped(q)
    assert got_exact == pytest.approx(exact, abs=6e-10)
    assert got_uniform == pytest.approx(uniform, abs=6e-10)
    assert got_over == pytest.approx(over, abs=6e-4)


def test_exudyn_clamped_bar():
    """Exudyn's ANCFBeamEigTest: L 2, square of 0.4, E 1e9, rho 7850.

    One linear element is the paper's model: 309.0977 rad/s, 10 % too high.  Right is (pi / 2L) sqrt(E / rho) =
    280.320625; their 256 elements come from above to 280.322475.
    """
    rod = jaxrod.Rod(length=2.0, section=jaxrod.Uniform(radius=0.4 / math.sqrt(math.pi)), young=1e9, density=7850.0)
    system = jaxrod.System(rod, jaxrod.Rotation())
    one_element = 2 * np.pi * float(jaxrod.natural_frequencies(system)[0])
    exact = 2 * np.pi * float(jaxrod.continuum.natural_frequencies(system, 1)[0])
    assert one_element == pytest.approx(309.0977, abs=6e-5)
    assert exact == pytest.approx(280.320625, abs=6e-7)
    assert exact == pytest.approx(math.pi / 4 * math.sqrt(1e9 / 7850), rel=1e-13)
    assert 0 < 280.322475 / exact - 1 < 1e-5


def test_exudyn_clamped_bar_on_higher_rungs():
    """Their 256 elements give 280.322475 rad/s; five strain shapes are nearer to the exact 280.320625."""
    rod = jaxrod.Rod(2.0, lambda s: 0.16 + 0 * s, young=1e9, density=7850.0)
    errors = []
    for n in (1, 2, 5):
        system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(n))
        errors.append(2 * math.pi * float(jaxrod.natural_frequencies(system)[0]) - 280.320625)
    assert errors[0] == pytest.approx(309.0977 - 280.320625, abs=1e-3)
    assert errors[0] > errors[1] > 0.1 and abs(errors[2]) < 1e-4 < 280.322475 - 280.320625
    exact = jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 1)[0]
    assert 2 * math.pi * float(exact) == pytest.approx(math.pi / 4 * math.sqrt(1e9 / 7850), rel=1e-12)


@pytest.mark.slow
def test_sslv104_spinning_bar():
    """SSLV104: a steel bar of 0.5 m at 3000 rad/s, 0.014625 m longer if its own lengthening adds no load.

    With the lengthening kept: tan(aL)/a - L exactly, k/(1 - k) L for uniform strain, a = W sqrt(rho/E), k = (aL)^2/3.
    The published figure is the first term of both.
    """
    length, young, density, spin = 0.5, 2e11, 7800.0, 3000.0
    rod = jaxrod.Rod(length, jaxrod.Uniform(0.01), young, density)

    def lengthening(basis, spin):
        system = jaxrod.System(rod, jaxrod.Rotation(), basis)
        return length * float(jaxrod.equilibrium(system, spin=spin).strain)

    def exact(spin):
        a = spin * math.sqrt(density / young)
        return math.tan(a * length) / a - length

    k = density * spin**2 * length**2 / (3 * young)
    assert k * length == pytest.approx(0.014625, abs=1e-9)
    assert lengthening(jaxrod.Ritz(8), spin) == pytest.approx(exact(spin), rel=1e-10)
    assert lengthening(jaxrod.Ritz(1), spin) == pytest.approx(k / (1 - k) * length, rel=1e-12)
    steady = jaxrod.continuum.steady_spin(jaxrod.System(rod, jaxrod.Rotation()), spin)
    assert float(steady) == pytest.approx(exact(spin), rel=1e-11)
    assert exact(spin) > 1.03 * 0.014625  # what the linear analysis misses
    assert lengthening(jaxrod.Ritz(8), spin / 100) == pytest.approx(0.014625e-4, rel=1e-4)


def test_modulus_fitted_through_the_uniform_strain_is_low(uniform):
    """A uniform rod's measured frequency, explained by a uniform strain, gives pi^2 / 12 of its modulus: 17.8 % low."""
    measured = jaxrod.continuum.natural_frequencies(jaxrod.System(uniform, jaxrod.Rotation()), 1)[0]
    model = jaxrod.natural_frequencies(jaxrod.System(uniform, jaxrod.Rotation()))[0]
    young = uniform.young * (measured / model) ** 2  # frequencies go as its square root
    fitted = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(radius=0.025), young=young, density=1200.0)
    explained = jaxrod.natural_frequencies(jaxrod.System(fitted, jaxrod.Rotation()))[0]
    assert explained == pytest.approx(float(measured), rel=1e-13)
    assert 100 * (1 - young / uniform.young) == pytest.approx(17.8, abs=0.05)
    assert young / uniform.young == pytest.approx(math.pi**2 / 12, rel=1e-13)


# ---- elastic pendulums

SAVED = 20_001  # one shape, one compilation


def spring_pendulum(mass, spring, unstretched, gravity):
    """A point mass on a spring, as a body with a uniform strain: q = position / unstretched length."""
    body = jaxrod.Lumped(mass * unstretched**2, mass * unstretched, spring * unstretched**2, unstretched)
    return jaxrod.System(body, jaxrod.Spherical(), gravity=gravity)


def placed(system, position, velocity):
    """The state with the mass at this position (m) and velocity (m/s)."""
    q, dq = (np.asarray(x, float) / float(system.rod.length) for x in (position, velocity))
    stretch = math.sqrt(q @ q)
    d, stretching = q / stretch, q @ dq / stretch
    arrays = (d, (dq - stretching * d) / stretch, np.array([stretch - 1]), np.array([stretching]), np.zeros(()))
    return jaxrod.State(*map(jnp.asarray, arrays))


@pytest.mark.slow
def test_swinging_spring_at_resonance():
    """Lynch (2002), Holm & Lynch (2002): stepwise precession of a spring that bounces twice a swing.

    They plot the plane of swing turning by "about 30 degrees" from one excursion to the next; computed, it is 29.90.
    """
    system = spring_pendulum(mass=1.0, spring=4 * math.pi**2, unstretched=0.75, gravity=math.pi**2)
    strain_rate = 2 * math.pi * jaxrod.natural_frequencies(system)[0]
    assert strain_rate == pytest.approx(2 * math.pi, rel=1e-14)  # and it swings at sqrt(g / 1 m) = pi
    ts = np.linspace(0, 120, SAVED)
    sol = jaxrod.simulate(system, placed(system, (0.04, 0.0, -1 + 0.08), (0.0, 0.03427, 0.0)), ts=ts)
    x, y, _ = np.asarray(sol.tip).T
    times, azimuths = excursions(ts, x, y)
    np.testing.assert_allclose(times, [12.5, 37.2, 62.1, 87.0, 111.7], rtol=0, atol=0.15)
    steps = np.diff(azimuths)
    np.testing.assert_allclose(steps, 29.90, rtol=0, atol=0.03)
    assert np.mean(steps) == pytest.approx(29.90, abs=0.01)


def excursions(ts, x, y):
    """When the swing is widest (s), by a parabola through the widest three of each excursion, and its azimuth (deg)."""
    width = np.hypot(x, y)
    ends = local_maxima(width)
    t, width = ts[ends], width[ends]
    tops = local_maxima(width)
    times = []
    for top in tops:
        a, b, _ = np.polyfit(t[top - 1 : top + 2] - t[top], width[top - 1 : top + 2], 2)
        times.append(t[top] - b / (2 * a))
    # A swing goes both ways: its azimuth is known modulo 180 degrees.
    return np.array(times), np.degrees(np.unwrap(2 * np.arctan2(y, x)[ends[tops]])) / 2


def local_maxima(values):
    return np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1


@pytest.mark.slow
def test_toronto_elastic_pendulum():
    """University of Toronto PHYD57 (2024): where a mass on a soft spring is after 1,000 s.

    It is pulled to between a third and more than eight times the spring's length.
    """
    system = spring_pendulum(mass=1.0, spring=33.0, unstretched=0.1, gravity=9.81)
    start = placed(system, (-0.1, 0.2, 0.1), (0.0, 0.0, -0.1))
    sol = jaxrod.simulate(system, start, ts=np.linspace(0, 1000, SAVED), tolerance=1e-10)
    want = [-0.0495486, 0.0990972, 0.0749817]
    np.testing.assert_allclose(sol.tip[-1], want, rtol=0, atol=1e-7)
    assert 0.1 * (1 + sol.strain[-1]) == pytest.approx(0.1337818, abs=1e-7)
    strain = scipy.interpolate.CubicHermiteSpline(sol.ts, sol.strain, sol.strain_rate)(np.linspace(0, 1000, 200_001))
    assert np.min(strain) == pytest.approx(-0.66, abs=0.005)
    assert np.max(strain) == pytest.approx(7.64, abs=0.005)
