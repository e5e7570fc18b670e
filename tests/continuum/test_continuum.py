"""The exact rod and what it leaves out, against figures of 15 digits and equations solved by bisection.

The figures come from the frequency equations in 34-digit arithmetic; those of the free spin from a Galerkin series,
to 1e-11.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.special
from conftest import scene

import jaxrod
from jaxrod import continuum
from jaxrod.continuum import neglected
from jaxrod.rods.section import AbstractSection

ROOT = jaxrod.Rotation()


def unit(section, motion=ROOT, **numbers):
    """Length, modulus and density 1 unless given: kappa = omega."""
    return scene(motion, section=section, **({"young": 1.0, "density": 1.0} | numbers))


def cone(r, R, motion=ROOT, **numbers):
    return unit(jaxrod.Cone(r, R), motion, **numbers)


def omega(system, n):
    return 2 * np.pi * np.asarray(continuum.natural_frequencies(system, n))


def bisect(equation, n, step=1e-3):
    """The first n positive zeros of a continuous function, to rounding."""
    grid = np.arange(1e-4, 40.0, step)
    at = equation(grid)
    (starts,) = np.nonzero(at[:-1] * at[1:] < 0)
    low, high = grid[starts[:n]], grid[starts[:n] + 1]
    for _ in range(60):
        middle = (low + high) / 2
        left = equation(low) * equation(middle) <= 0
        low, high = np.where(left, low, middle), np.where(left, middle, high)
    assert low.size == n
    return low


def close(got, want, rtol=1e-10):
    np.testing.assert_allclose(np.asarray(got), np.asarray(want), rtol=rtol, atol=0)


# ---- figures computed elsewhere

HELD_FREE = {  # (root radius, tip radius): kappa held at the root, kappa free
    (1.0, 0.5): (
        [2.028757838110434, 4.913180439434884, 7.978665712413241, 11.085538406497022, 14.207436725191188],
        [3.2860065995081755, 6.360678173709009, 9.477196047926254, 12.605889618118281, 15.739655563922398],
    ),
    (1.0, 1.0): (
        [1.5707963267948966, 4.71238898038469, 7.853981633974483, 10.995574287564276, 14.137166941154069],
        [3.141592653589793, 6.283185307179586, 9.42477796076938, 12.566370614359172, 15.707963267948966],
    ),
    (1.0, 1.5): (
        [1.3241944495755027, 4.640683630775554, 7.811334475130868, 10.96518440092889, 14.113553371514504],
        [3.1929069572704867, 6.309484372833035, 9.442394095375377, 12.579604861229722, 15.71855890099735],
    ),
    (1.0, 2.0): (
        [1.1655611852072114, 4.604216777200577, 7.789883751144573, 10.94994364854116, 14.101725133565873],
        [3.2860065995081755, 6.360678173709009, 9.477196047926254, 12.605889618118281, 15.739655563922398],
    ),
    (1.0, 5.0): (
        [0.7593076890306316, 4.537888582246557, 7.751135101682629, 10.922461277453092, 14.080411438251641],
        [3.7491240061696725, 6.702448849972797, 9.732705784324297, 12.806719946668412, 15.904101078539005],
    ),
    (1.0, 10.0): (
        [0.5422808854161556, 4.515660437913874, 7.738195664946898, 10.913292244514555, 14.073303036187832],
        [4.070058145414589, 7.061905925802979, 10.065183558365886, 13.099747103217823, 16.160465726239686],
    ),
    (1.0, 100.0): (
        [0.17303198713330553, 4.495634935639374, 7.726546292384993],
        [4.448506748116547, 7.648153468547087, 10.795508884362635],
    ),
    (1.0, 1000.0): (
        [0.05476677887708412, 4.493632006063654, 7.7253812825552],
        [4.488916080158572, 7.717526741193782, 10.893217973103585],
    ),
    (3.0, 2.0): (
        [1.8365972031521258, 4.815842317845935, 7.917052684666207, 11.040829817971295, 14.172432074799941],
        None,
    ),
}


@pytest.mark.parametrize("radii", HELD_FREE)
def test_cones(radii):
    held, free = HELD_FREE[radii]
    close(omega(cone(*radii), 5)[: len(held)], held, 1e-12)
    if free is not None:
        close(omega(cone(*radii, jaxrod.Flight()), 5)[: len(free)], free, 1e-12)
        close(omega(cone(*radii[::-1], jaxrod.Flight()), 5)[: len(free)], free, 1e-12)


UNIFORM_TIP = {
    0.1: [1.428870011214077, 4.305801413119223, 7.228109771627249],
    0.5: [1.0768739863118038, 3.643597167425401, 6.578333732722339],
    1.0: [0.8603335890193797, 3.4256184594817283, 6.437298179171947],
    2.0: [0.6532711870944031, 3.2923100212820864, 6.361620392065665],
    10.0: [0.3110528482002977, 3.1730971766928695, 6.299059359895646],
    100.0: [0.09983363855112636, 3.144772523110166, 6.284776452327979],
}
CONE_TIP = {  # radii 0.02 and 0.03
    0.1: [1.2270043493205591, 4.346988880676173, 7.3419297911150965],
    1.0: [0.7960512029943574, 3.5130615230165954, 6.496225107534993],
    10.0: [0.300711477045746, 3.185959929014116, 6.30569072581502],
}


@pytest.mark.parametrize(("radii", "figures"), [((1.0, 1.0), UNIFORM_TIP), ((0.02, 0.03), CONE_TIP)])
def test_tip_mass(radii, figures):
    bare = cone(*radii).rod.mass
    for ratio, kappa in figures.items():
        close(omega(cone(*radii, tip_mass=ratio * bare), 3), kappa, 1e-12)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 20.0])
def test_tip_mass_in_flight(ratio):
    """(rho A) tan kappa = -M kappa: of the uniform rod, free at both ends."""
    system = unit(jaxrod.Uniform(0.3), jaxrod.Flight(), tip_mass=ratio * np.pi * 0.3**2)
    close(omega(system, 4), bisect(lambda k: np.sin(k) + ratio * k * np.cos(k), 4), 1e-12)


@pytest.mark.parametrize(
    ("radii", "pivot", "figures"),
    [
        ((0.02, 0.03), 0.3, [183.40670090368266, 505.3855151865402, 608.0222180138862, 1020.3508323461358]),
        ((0.025, 0.025), 0.5, [286.7868604772738, 286.7868604772738, 860.3605814318215, 860.3605814318215]),
        ((0.02, 0.03), 1.0, [167.65761953621958, 439.62424514536383, 722.724724058086, 1007.885257479756]),
    ],
)
def test_pivot_inside(radii, pivot, figures):
    close(omega(cone(*radii, jaxrod.Rotation(pivot), young=1e7, density=1200.0), 4), figures, 1e-12)


SPIN = {  # radii: kappa_1 of the rod at rest, {rate / kappa_1: (tip displacement / length, prescribed, free)}
    (1.0, 1.0): (
        1.5707963267948966,
        {
            0.05: (
                0.0020612536725743897,
                [1.5688316026653908, 4.711734436457595],
                [1.5765629953688187, 4.711766193826123],
            ),
            0.5: (0.2732395447351627, [1.3603495231756635, 4.6464781961592125], [2.072212924712827, 4.648684667090002]),
            0.95: (7.514759122946763, [0.4904809958362843, 4.469874764403951], [3.024119367359983, 4.470137889590868]),
        },
    ),
    (2.0, 3.0): (
        1.3241944495755027,
        {
            0.1: (
                0.008117065646097587,
                [1.3175568416139407, 4.638793986754027],
                [1.3433151527169622, 4.638947667389806],
            ),
            0.7: (0.7675860660728702, [0.9456639887117146, 4.547167689915093], [2.0746279132724896, 4.549869353916116]),
            0.9: (3.3917869927259696, [0.5772029787297083, 4.485043689788992], [2.450902838079607, 4.485818782564601]),
        },
    ),
    (3.0, 2.0): (
        1.8365972031521258,
        {0.5: (0.2801441516072471, [1.5905398344491903, 4.727479762907416], [2.425884895980513, 4.728940367860744])},
    ),
    (1.0, 5.0): (
        0.7593076890306316,
        {0.9: (3.262430422805552, [0.33097454835379303, 4.486137399804049], [1.404925110296481, 4.486530746507541])},
    ),
}


@pytest.mark.parametrize("radii", SPIN)
def test_spin(radii):
    critical, by_rate = SPIN[radii]
    system = cone(*radii)
    close(continuum.critical_rate(system), critical, 1e-12)
    for fraction, (tip, prescribed, free) in by_rate.items():
        rate = fraction * critical
        close(continuum.steady_spin(system, rate), tip, 3e-12 if radii == (1.0, 5.0) else 1e-12)
        close(2 * np.pi * continuum.spinning_frequencies(system, rate, 2), prescribed, 1e-12)
        # the Galerkin series gives ten digits of the steepest cone
        close(2 * np.pi * continuum.spinning_frequencies(system, rate, 2, free=True), free, 1e-10)


def steady_tip_of_cone(root, tip, k):
    """Tip displacement over length at K = rate length / wave speed: w = radius u solves w'' + K^2 w = -K^2 s radius."""
    slope = tip - root
    part = -tip + 2 * slope / k**2 * (1 - np.cos(k))
    part_slope = -root - 2 * slope + 2 * slope / k * np.sin(k)
    sine = (slope * part - tip * part_slope) / (tip * k * np.cos(k) - slope * np.sin(k))
    return (part + sine * np.sin(k)) / tip


def test_steady_spin_of_cones():
    for radii, fraction in (((1.0, 7.0), 0.3), ((1.0, 0.2), 0.8), ((1.0, 1.0), 0.6)):
        system = cone(*radii)
        k = fraction * float(continuum.critical_rate(system))
        close(continuum.steady_spin(system, k), steady_tip_of_cone(*radii, k), 1e-12)
    # In units of one's own: K = 15 rad/s * 0.5 m / (91.3 m/s).
    system = scene(length=0.5)
    want = 0.5 * steady_tip_of_cone(0.02, 0.03, 15.0 * 0.5 / np.sqrt(1e7 / 1200.0))
    close(continuum.steady_spin(system, 15.0), want, 1e-11)  # the formula cancels


def test_spin_where_it_ends_and_where_it_begins():
    system = unit(jaxrod.Uniform(1.0))
    tip = functools.partial(continuum.steady_spin, system)
    assert float(tip(0.0)) == 0.0
    close(jax.jacfwd(jax.grad(tip))(0.0), 2 / 3, 1e-10)  # tan K / K - 1 = K^2 / 3 + ...
    assert np.isnan(tip(1.6)) and np.isnan(continuum.spinning_frequencies(system, 1.6, 2, free=True)).all()
    beyond = continuum.spinning_frequencies(system, 1.6, 2)
    assert np.isnan(beyond[0])
    second = np.sqrt((1.5 * np.pi) ** 2 - 1.6**2)
    close(2 * np.pi * beyond[1], second, 1e-12)
    slope = jax.jacrev(lambda rate: continuum.spinning_frequencies(system, rate, 2)[1])(1.6)
    close(2 * np.pi * slope, -1.6 / second, 1e-12)
    close(continuum.spinning_frequencies(system, 0.0, 2, free=True), continuum.natural_frequencies(system, 2), 1e-12)


def test_spin_elsewhere():
    """A uniform rod in flight, or held in the middle, is two rods of half the length held at their roots."""
    half = unit(jaxrod.Uniform(1.0), length=0.5)
    for motion in (jaxrod.Flight(), jaxrod.Rotation(0.5)):
        whole = unit(jaxrod.Uniform(1.0), motion)
        close(continuum.steady_spin(whole, 2.0), continuum.steady_spin(half, 2.0), 1e-12)
        # Both halves stretch together, and their inertia with them.
        slowed = continuum.spinning_frequencies(half, 2.0, 1, free=True)[0]
        found = np.asarray(continuum.spinning_frequencies(whole, 2.0, 3, free=True))
        assert np.min(np.abs(found / slowed - 1)) < 1e-12
    # Much inertia at the tip keeps the rate as prescribed.
    flywheel = unit(jaxrod.Uniform(1.0), tip_mass=0.1, tip_inertia=1e9)
    free, prescribed = (continuum.spinning_frequencies(flywheel, 1.0, 2, free=free) for free in (True, False))
    close(free, prescribed, 1e-6)
    assert abs(free[0] / continuum.natural_frequencies(flywheel, 1)[0] - 1) > 0.1


# ---- steps, tables, composites


def stepped(motion=ROOT, **numbers):
    """Root part of length 0.4, tip part of 0.6."""
    area, young, density = (
        jaxrod.PiecewiseConstant([0.4], values) if np.ndim(values) else values
        for values in (numbers.get("area", [1.0, 1.0]), numbers.get("young", 1.0), numbers.get("density", 1.0))
    )
    return unit(area, motion, young=young, density=density)


def steps_equation(area, young, density):
    """Z1 = Z2 tan(k1 a) tan(k2 b) with Z = A sqrt(E rho), k = omega sqrt(rho / E): held at the root."""
    (A1, A2), (E1, E2), (d1, d2) = area, young, density
    Z1, Z2 = A1 * np.sqrt(E1 * d1), A2 * np.sqrt(E2 * d2)

    def equation(w):
        x, y = w * np.sqrt(d1 / E1) * 0.4, w * np.sqrt(d2 / E2) * 0.6
        return Z1 * np.cos(x) * np.cos(y) - Z2 * np.sin(x) * np.sin(y)

    return equation


def test_steps():
    close(omega(stepped(), 5), (np.arange(5) + 0.5) * np.pi, 1e-12)
    for area in ([4.0, 1.0], [1.0, 4.0]):
        close(omega(stepped(area=area), 5), bisect(steps_equation(area, [1.0, 1.0], [1.0, 1.0]), 5), 1e-12)


def test_composites():
    numbers = {"area": [2.0, 1.0], "young": [1.0, 9.0], "density": [1.0, 0.25]}
    close(omega(stepped(**numbers), 5), bisect(steps_equation(*numbers.values()), 5), 1e-12)


def test_exponential_profile():
    """A = exp(a s): w = exp(a s / 2) u obeys w'' + (omega^2 - a^2 / 4) w = 0, so tan q = 2 q / a at a free tip."""
    a = 1.0
    q = bisect(lambda q: a / 2 * np.sin(q) - q * np.cos(q), 5)
    close(omega(unit(lambda s: jnp.exp(a * s)), 5), np.sqrt(q**2 + a**2 / 4), 1e-12)


def test_tables():
    """Eight times finer: an error at least 8^3 times smaller, down to that of the interpolation."""
    exact = omega(cone(0.02, 0.03), 2)
    errors = []
    with jax.numpy_rank_promotion("allow"):  # interpax promotes
        for points in (5, 33):
            s = np.linspace(0.0, 1.0, points)
            errors.append(np.abs(omega(unit(jaxrod.Table(s, radii=0.02 + 0.01 * s)), 2) / exact - 1))
    assert np.all(errors[1] < 1e-7) and np.all(errors[1] < errors[0] / 8**2)


@pytest.mark.parametrize("radii", [(1.0, 1.0), (1.0, 1000.0), (1000.0, 1.0), (1.0, 0.0)])
def test_forty_frequencies(radii):
    """Of tapers of a thousand and of a point, against the closed forms."""
    r, R = map(jnp.asarray, radii)
    close(omega(cone(*radii), 40), continuum.held_free(r, R, 40), 1e-12)
    close(omega(cone(*radii, jaxrod.Flight()), 40), continuum.free_free(r, R, 40), 1e-12)


# ---- derivatives


def numbered(kind, p):
    """The first three frequencies, for numbers (length, root, tip, young, density, tip mass, pivot)."""
    length, r, R, young, density, tip_mass, pivot = p
    motion = {"root": ROOT, "inside": jaxrod.Rotation(pivot), "flight": jaxrod.Flight()}[kind]
    return continuum.natural_frequencies(
        cone(r, R, motion, length=length, young=young, density=density, tip_mass=tip_mass), 3
    )


NUMBERS = np.array([1.3, 0.02, 0.03, 1e7, 1200.0, 0.4, 0.45])


@pytest.mark.parametrize("kind", ["root", "inside", "flight"])
def test_derivatives(kind):
    function = functools.partial(numbered, kind)
    value = jax.jit(function)
    f = np.asarray(value(NUMBERS))[:, None]
    forward, reverse = (np.asarray(jax.jit(jac(function))(NUMBERS)) * NUMBERS / f for jac in (jax.jacfwd, jax.jacrev))
    step = 1e-3
    moved = [np.stack([value(NUMBERS * (1 + k * step * row)) for row in np.eye(7)], axis=1) for k in (1, -1, 2, -2)]
    differences = (8 * (moved[0] - moved[1]) - (moved[2] - moved[3])) / (12 * step) / f
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=1e-12)
    np.testing.assert_allclose(reverse, differences, rtol=0, atol=1e-8)
    assert np.all((np.abs(reverse[:, 5]) > 1e-3) == [True, kind != "inside", True])  # the near part has no tip
    assert np.all((np.abs(reverse[:, 6]) > 1e-3) == (kind == "inside"))


@pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev])
def test_derivatives_where_frequencies_coincide(jacobian):
    """A uniform rod held at p: (k - 1/2) / 2 over the length of either part.  Also with a part of no length."""
    function = lambda p: continuum.natural_frequencies(unit(jaxrod.Uniform(0.02), jaxrod.Rotation(p)), 4)  # noqa: E731
    slopes = jax.jit(jacobian(function))
    f = np.array([0.5, 1.5]) / 2
    slope = np.asarray(slopes(0.5)).reshape(2, 2)
    np.testing.assert_allclose(np.sort(slope, axis=1), 4 * f[:, None] * np.array([[-1.0, 1.0]]), rtol=1e-12)
    f = (np.arange(4) + 0.5) / 2
    close(slopes(0.0), f, 1e-12)
    close(slopes(1.0), -f, 1e-12)
    # at the end of a panel of the cone's, with equal radii and without
    on_knot = jax.jit(jacobian(lambda p: continuum.natural_frequencies(cone(0.02, 0.02, jaxrod.Rotation(p)), 2)))(0.25)
    close(on_knot, np.array([0.25 / 0.75**2, 0.75 / 0.75**2]), 1e-12)


def test_derivative_at_no_tip_mass():
    """d omega / omega = -u_tip^2 dM / (2 int rho A u^2): -1 / (rho A l) of the uniform rod, every mode alike."""
    system = unit(lambda s: jnp.ones_like(s), tip_mass=0.0)

    def log(tip_mass):
        return jnp.log(continuum.natural_frequencies(eqx.tree_at(lambda x: x.rod.tip_mass, system, tip_mass), 3))

    np.testing.assert_allclose(jax.jit(jax.jacrev(log))(0.0), -1.0, rtol=1e-7)


def test_derivatives_of_a_table():
    """The end of the table is the end of the rod; frequencies go as 1 / length and not with the scale of the radii."""
    s = np.array([0.0, 0.3, 1.0])

    def log(p):
        section = jaxrod.Table(p[0] * s, radii=p[1] * jnp.array([0.02, 0.026, 0.03]))
        return jnp.log(continuum.natural_frequencies(unit(section, length=p[0]), 2))

    with jax.numpy_rank_promotion("allow"):
        slope = jax.jit(jax.jacrev(log))(jnp.array([1.0, 1.0]))
    np.testing.assert_allclose(slope, [[-1.0, 0.0]] * 2, rtol=0, atol=1e-9)


def test_derivatives_of_a_table_with_a_point_on_a_break():
    """The modulus jumps at 0.3 m, from where the second point moves."""

    def log(position):
        section = jaxrod.Table(jnp.stack([0.0, position, 1.0]), radii=[0.02, 0.03, 0.01])
        return jnp.log(
            continuum.natural_frequencies(unit(section, young=jaxrod.PiecewiseConstant([0.3], [1.0, 4.0])), 2)
        )

    with jax.numpy_rank_promotion("allow"):
        slope, value = jax.jit(jax.jacrev(log))(0.3), jax.jit(log)
        step = 1e-5
        np.testing.assert_allclose(slope, (value(0.3 + step) - value(0.3 - step)) / (2 * step), rtol=1e-5)


def test_derivatives_of_spinning_frequencies():
    def function(p):
        system = cone(p[0], 0.03, jaxrod.Rotation(p[1]), young=1e7, density=1200.0)
        free = continuum.spinning_frequencies(system, p[2], 2, free=True)
        return jnp.append(
            jnp.append(free, continuum.spinning_frequencies(system, p[2], 2)), continuum.steady_spin(system, p[2])
        )

    p, step, value = np.array([0.02, 0.3, 60.0]), 1e-4, jax.jit(function)
    slope = np.asarray(jax.jit(jax.jacrev(function))(p)) * p
    moved = [np.stack([value(p * (1 + k * step * row)) for row in np.eye(3)], axis=1) for k in (1, -1)]
    np.testing.assert_allclose(slope, (moved[0] - moved[1]) / (2 * step), rtol=1e-6, atol=1e-6)


# ---- transforms, refusals


def test_vmap_is_a_loop():
    function = lambda p: numbered("inside", NUMBERS * jnp.array([1, 1, 1, 1, 1, 1, 0]) + p * jnp.eye(7)[6])  # noqa: E731
    one, pivots = jax.jit(function), jnp.array([0.0, 0.2, 0.65, 1.3])
    close(jax.jit(jax.vmap(function))(pivots), np.stack([one(p) for p in pivots]), 1e-12)
    eager = cone(0.02, 0.03)
    close(
        jax.jit(lambda system: continuum.natural_frequencies(system, 3))(eager),
        continuum.natural_frequencies(eager, 3),
        1e-13,
    )


def test_none_asked_for():
    with pytest.raises(ValueError, match="n=0 must be a whole number"):
        continuum.natural_frequencies(cone(1.0, 2.0), 0)


def test_single_precision():
    f = jnp.float32
    system = cone(f(0.02), f(0.03), length=f(1.0), young=f(1e7), density=f(1200.0))
    got = continuum.natural_frequencies(system, 3)
    assert got.dtype == jnp.float32
    close(got, continuum.natural_frequencies(scene(), 3), 1e-5)


def test_refusals():
    lumped = scene(rod=jaxrod.Lumped(1.0, 1.0, 1.0, 1.0))
    for function in (
        lambda s: continuum.natural_frequencies(s, 1),
        lambda s: continuum.steady_spin(s, 1.0),
        lambda s: continuum.spinning_frequencies(s, 1.0, 1),
        neglected.model_limits,
    ):
        with pytest.raises(ValueError, match=r"rod=Lumped.*give a Rod"):
            function(lumped)
    for n in (-1, 1.5, True):
        with pytest.raises(ValueError, match=f"n={n} must be a whole number"):
            continuum.natural_frequencies(cone(1.0, 2.0), n)
    rubber = cone(0.02, 0.03, law=jaxrod.law.neo_hookean)
    close(omega(rubber, 2), omega(cone(0.02, 0.03), 2), 1e-13)  # at rest any law is Hooke's
    with pytest.raises(ValueError, match=r"law=.*of Hooke's law; leave out law="):
        continuum.steady_spin(rubber, 0.1)
    for system, message in (
        (cone(1.0, 2.0, jaxrod.Flight()), "held at its root"),
        (cone(1.0, 2.0, jaxrod.Rotation(0.5)), "held at its root"),
        (cone(1.0, 2.0, tip_mass=1.0), "leave out tip_mass="),
        (stepped(), "of one material|needs section=Uniform"),
        (unit(jaxrod.Uniform(1.0), young=jaxrod.PiecewiseConstant([0.5], [1.0, 2.0])), "of one material"),
    ):
        with pytest.raises(ValueError, match=message):
            continuum.release(system, 0.01, np.ones(1))


# ---- what the model leaves out


_bending = eqx.filter_jit(neglected._bending)


def bending(system, n=2):
    """Roots of the frequencies over sqrt(E I / rho A) / (2 pi l^2) of the uniform rod with radius 0.02."""
    rod, pivot, _ = continuum.support(system)
    support = neglected.model_limits(system).support
    return np.sqrt(np.asarray(_bending(rod, pivot, support, n)) * 2 * np.pi / 0.01)


def hinged_free(k):
    return np.sin(k) * np.cosh(k) - np.cos(k) * np.sinh(k)


DRIVEN = jaxrod.Driven(lambda t: t)


@pytest.mark.parametrize(
    ("motion", "equation"),
    [
        (ROOT, hinged_free),
        (jaxrod.Spherical(1.0), hinged_free),
        (jaxrod.Flight(), lambda k: np.cos(k) * np.cosh(k) - 1),
        (DRIVEN, lambda k: np.cos(k) * np.cosh(k) + 1),
    ],
)
def test_bending_of_the_uniform_rod(motion, equation):
    known = {"hinged": [3.9266, 7.0686], "free": [4.7300, 7.8532], "clamped": [1.8751, 4.6941]}
    system = unit(jaxrod.Uniform(0.02), motion)
    kappa = bisect(lambda k: equation(k) / np.cosh(k), 4, 1e-2)
    kappa = kappa[kappa > 0.1]
    np.testing.assert_allclose(kappa[:2], known[neglected.model_limits(system).support], atol=5e-5)
    close(bending(system, 2), kappa[:2], 1e-10)


def test_bending_held_inside():
    """Hinged in the middle: two clamped halves in step, and the free rod's odd mode.  Clamped: two halves."""
    uniform = jaxrod.Uniform(0.02)
    close(bending(unit(uniform, jaxrod.Rotation(0.5))), [2 * 1.8751040687119611, 7.853204624095838], 1e-10)
    clamped = unit(uniform, jaxrod.Driven(lambda t: t, pivot=0.5))
    close(bending(clamped), [2 * 1.8751040687119611] * 2, 1e-10)


def test_bending_of_a_pointed_cantilever():
    """Kirchhoff: J_2 I_3 + J_3 I_2 = 0 at z, omega = z^2 / 4 sqrt(E I / rho A) / l^2 of the root: 8.719, 21.15."""
    J, I = scipy.special.jv, scipy.special.iv  # noqa: E741
    z = bisect(lambda z: J(2, z) * I(3, z) * np.exp(-z) + J(3, z) * I(2, z) * np.exp(-z), 2, 1e-2)
    np.testing.assert_allclose(z**2 / 4, [8.719, 21.15], rtol=3e-4)
    close(bending(cone(0.02, 0.0, DRIVEN)) ** 2, z**2 / 4, 1e-10)


@pytest.mark.parametrize(("mass", "inertia"), [(0.7, 0.0), (0.7, 0.2)])
def test_bending_with_a_body_at_the_tip(mass, inertia):
    """Clamped: w = a (cosh - cos) + b (sinh - sin); at the tip w''' = -M k^4 w and w'' = J k^4 w'."""

    def determinant(k):
        c, s, C, S = np.cos(k), np.sin(k), np.cosh(k), np.sinh(k)
        shear = [k**3 * (S - s) + mass * k**4 * (C - c), k**3 * (C + c) + mass * k**4 * (S - s)]
        moment = [k**2 * (C + c) - inertia * k**5 * (S + s), k**2 * (S + s) - inertia * k**5 * (C - c)]
        return (shear[0] * moment[1] - shear[1] * moment[0]) / k**5 / C**2

    whole = np.pi * 0.02**2
    system = unit(jaxrod.Uniform(0.02), DRIVEN, tip_mass=mass * whole, tip_inertia=inertia * whole)
    close(bending(system), bisect(determinant, 2, 1e-2), 1e-10)


def finite_elements(r, R, elements=80):
    """The first two bending frequencies in Hz of a hinged cone (E 1e7, rho 1200) by Hermite beam elements."""
    h, size = 1 / elements, 2 * elements + 2
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    x, w = np.polynomial.legendre.leggauss(6)
    x, w = (x + 1) / 2, w / 2 * h
    curvature = np.array([-6 + 12 * x, h * (-4 + 6 * x), 6 - 12 * x, h * (-2 + 6 * x)]) / h**2
    shape = np.array([1 - 3 * x**2 + 2 * x**3, h * (x - 2 * x**2 + x**3), 3 * x**2 - 2 * x**3, h * (x**3 - x**2)])
    for e in range(elements):
        radius, block = r + (R - r) * (e + x) * h, slice(2 * e, 2 * e + 4)
        stiffness[block, block] += (curvature * (w * 1e7 * np.pi * radius**4 / 4)) @ curvature.T
        mass[block, block] += (shape * (w * 1200 * np.pi * radius**2)) @ shape.T
    square = scipy.linalg.eigh(stiffness[1:, 1:], mass[1:, 1:], eigvals_only=True, subset_by_index=[1, 2])
    return np.sqrt(square) / (2 * np.pi)


def test_the_paper_s_rod():
    found = neglected.model_limits(scene())
    np.testing.assert_allclose(found.bending_frequencies, finite_elements(0.02, 0.03), rtol=1e-6)
    close(found.axial_frequency, 120.88186175927335 / (2 * np.pi), 1e-12)
    close(found.slenderness, 80.0, 1e-12)
    assert str(found).splitlines()[0] == (
        "bending (hinged, straight, unstressed): 2.557 and 8.82 Hz; the model has none"
    )
    assert "axial: 19.24 Hz; lateral inertia lowers it by 0.0057 % or less" in str(found)


def test_lateral_inertia_of_the_uniform_rod():
    """nu^2 kappa^2 r^2 / (4 l^2) to first order, for any support."""
    for motion, kappa in ((ROOT, np.pi / 2), (jaxrod.Flight(), np.pi), (jaxrod.Rotation(0.5), np.pi)):
        small = 0.5**2 * kappa**2 * 0.01**2 / 4
        found = neglected.model_limits(unit(jaxrod.Uniform(0.01), motion)).lateral_inertia
        close(found, 1 - 1 / np.sqrt(1 + 2 * small), 1e-10)
        close(found, small, 1e-3)


class Flat(AbstractSection):
    """A strip 0.03 m wide and 0.002 m thick."""

    breaks = ()

    def area(self, s, length):
        return 6e-5 * jnp.ones_like(s)

    def second_moment(self, s, length):
        return 0.03 * 0.002**3 / 12 * jnp.ones_like(s)


def test_a_section_with_its_own_second_moment():
    found = neglected.model_limits(unit(Flat()))
    gyration = 0.002 / np.sqrt(12)
    close(found.bending_frequencies[0], 3.926602312047919**2 * gyration / (2 * np.pi), 1e-10)
    close(found.slenderness, 1 / gyration, 1e-12)


@pytest.mark.parametrize("radii", [(1.0, 1000.0), (1000.0, 1.0), (1.0, 0.0), (0.02, 0.03)])
def test_bending_has_converged(radii):
    rod = cone(*radii).rod
    for support in ("hinged", "free", "clamped"):
        coarse, fine = (_bending(rod, None, support, order=order) for order in (16, 32))
        close(coarse, fine, 1e-11)
