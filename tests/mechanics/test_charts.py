"""Coordinates are nobody's business: charts agree, turns are counted whatever is saved, and the pole is no place."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod

GRAVITY = 9.81
CHARTS = [jaxrod.Angles(), jaxrod.Embedded(), jaxrod.Director()]
MOTIONS = [jaxrod.Rotation(), jaxrod.Spherical(), jaxrod.Flight()]


def name_of(value):
    return type(value).__name__


charts = pytest.mark.parametrize("chart", CHARTS, ids=name_of)


# ---- fifty turns: in the plane about the axis, in space about the vertical, once forwards and once backwards


def fifty_turns(cone, motion):
    """A scene, a start that has some turns behind it, and the time that fifty more take."""
    if motion == "plane":
        system = jaxrod.System(cone, jaxrod.Rotation(), gravity=GRAVITY)
        return system, system.state(angle=-20.0, rate=-40.0, strain=0.01), 9.0
    system = jaxrod.System(cone, jaxrod.Spherical(), gravity=GRAVITY)
    return system, system.state(angle=-0.5, rate=3.0, azimuth=20.0, azimuth_rate=30.0, strain=0.01), 13.0


def turned(sol):
    """The counted angle."""
    return np.asarray(sol.angle if sol.states.planar else sol.azimuth)


_SOLVED = {}


def solved(cone, motion, chart, points):
    """Runs are kept: each is a compilation."""
    key = motion, name_of(chart), points
    if key not in _SOLVED:
        system, start, t1 = fifty_turns(cone, motion)
        _SOLVED[key] = jaxrod.simulate(system, start, ts=np.linspace(0, t1, points), chart=chart, tolerance=1e-10)
    return _SOLVED[key]


@pytest.mark.parametrize("motion", ["plane", "space"])
@charts
def test_charts_agree(chart, motion, cone):
    """Over 50 turns: 200 axial periods in the plane, 300 in space."""
    sol, reference = (solved(cone, motion, which, 2) for which in (chart, jaxrod.Embedded()))
    omega = 2 * np.pi * float(jaxrod.natural_frequencies(sol.system)[0])
    got, want = (jax.tree.map(lambda x: np.asarray(x)[-1], x.states) for x in (sol, reference))
    np.testing.assert_allclose(got.direction, want.direction, rtol=0, atol=1e-9)
    np.testing.assert_allclose(got.amplitudes, want.amplitudes, rtol=0, atol=1e-9)
    np.testing.assert_allclose(got.direction_rate, want.direction_rate, rtol=0, atol=1e-9 * omega)
    np.testing.assert_allclose(got.amplitude_rates, want.amplitude_rates, rtol=0, atol=1e-9 * omega)
    assert got.turns == want.turns
    assert abs(turned(sol)[-1] - turned(sol)[0]) > 50 * 2 * math.pi, "fewer turns than meant"


@pytest.mark.parametrize("motion", ["plane", "space"])
def test_angle_is_continuous_whatever_is_saved(motion, cone):
    """`Angles` know their turns; for `Embedded` the solver counts them, at two save times as at a thousand."""
    chart = jaxrod.Embedded()
    few, many = (turned(solved(cone, motion, chart, points)) for points in (2, 1000))
    np.testing.assert_allclose(few, many[[0, -1]], rtol=0, atol=1e-9 * abs(many[-1] - many[0]))
    assert np.max(np.abs(np.diff(many))) < 1.0, "a jump between saved angles"
    assert many[0] == pytest.approx(-20.0 if motion == "plane" else 20.0, rel=1e-14), "the turns at the start"


# ---- round trips


@pytest.mark.parametrize("motion", MOTIONS, ids=name_of)
def test_round_trip(motion, cone):
    rng, n = np.random.default_rng(1), 300
    system = jaxrod.System(cone, motion, gravity=GRAVITY)
    space = motion.dimension == 3
    keywords = {
        "angle": rng.uniform(-1.5, 1.5, n) if space else rng.uniform(-100, 100, n),
        "rate": rng.normal(0, 30, n),
        "strain": rng.uniform(-0.9, 3, n),
        "strain_rate": rng.normal(0, 30, n),
    }
    if space:
        keywords |= {"azimuth": rng.uniform(-100, 100, n), "azimuth_rate": rng.normal(0, 30, n)}
    if isinstance(motion, jaxrod.Flight):
        keywords |= {"center": rng.normal(0, 10, (n, 2)), "center_velocity": rng.normal(0, 10, (n, 2))}

    def there_and_back(keywords):
        state, backs = system.state(**keywords), {}
        for chart in CHARTS:
            q, v = chart.encode(motion, state)
            back = chart.decode(motion, 0.0, q, v, state.turns)
            backs[name_of(chart)] = back, {name: getattr(back, name) for name in keywords}
        return state, backs

    state, backs = jax.jit(jax.vmap(there_and_back))(keywords)
    for chart, (back, read) in backs.items():
        for name, value in vars(state).items():
            if value is not None:
                scale = max(1.0, float(jnp.max(jnp.abs(value))))
                message = f"{chart}: {name}"
                np.testing.assert_allclose(vars(back)[name], value, rtol=0, atol=1e-13 * scale, err_msg=message)
        for name, value in keywords.items():
            # An azimuth and its rate are known as well as the rod is away from the pole, here by cos 1.5 = 0.07.
            scale = max(1.0, np.max(np.abs(value))) / (0.07 if "azimuth" in name else 1.0)
            np.testing.assert_allclose(read[name], value, rtol=0, atol=1e-13 * scale, err_msg=f"{chart}: {name}")


# ---- the pole


def test_angles_past_the_pole():
    """psi beyond pi / 2 is the other side of the pole: elevation pi - psi, azimuth phi + pi, whole turns kept."""
    motion = jaxrod.Spherical()
    for psi, phi in ((2.0, 0.5), (-2.5, 3.0), (1.0, 40.0), (4.0, -50.0)):
        state = CHARTS[0].decode(motion, 0.0, jnp.array([psi, phi, 0.1]), jnp.array([1.0, 0.2, 0.3]))
        over = math.cos(psi) < 0
        assert float(state.angle) == pytest.approx(math.asin(math.sin(psi)), abs=1e-14)
        assert float(state.rate) == pytest.approx(-1.0 if over else 1.0, abs=1e-14)
        assert float(state.azimuth) == pytest.approx(phi + math.pi * over, rel=1e-14)
        assert float(state.azimuth_rate) == pytest.approx(0.2, rel=1e-13)


START = {"angle": 0.3, "rate": 12.0, "azimuth": 0.5}
PASSING = {  # like the scenes sph_generic, sph_pole_1e-3, sph_pole_1e-8 and sph_exact_pole of truth.json
    "far": {"azimuth_rate": 3.0},
    "1e-3": {"azimuth_rate": 0.013},
    "1e-8": {"azimuth_rate": 1.3e-7},
    "0": {"azimuth_rate": 0.0},
}
TIMES = np.array([0.45, 1.0])  # the pole is passed at 0.37 s


def passing(cone, chart, which, tolerance=None):
    system = jaxrod.System(cone, jaxrod.Spherical(), gravity=GRAVITY)
    start = system.state(**START, **PASSING[which])
    return jaxrod.simulate(system, start, ts=TIMES, chart=chart, tolerance=tolerance)


@pytest.mark.parametrize("which", ["1e-3", "1e-8", "0"])
@pytest.mark.parametrize("chart", [jaxrod.Embedded(), jaxrod.Director()], ids=name_of)
def test_the_pole_costs_no_steps(chart, which, cone):
    near, far = passing(cone, chart, which), passing(cone, chart, "far")
    assert near.stats["num_steps"] <= 1.2 * far.stats["num_steps"]
    assert far.stats["num_steps"] > 100, "too few steps to compare"


@pytest.mark.parametrize("chart", [jaxrod.Embedded(), jaxrod.Director()], ids=name_of)
def test_through_the_pole_is_rotation_about_a_fixed_axis(chart, cone):
    space = passing(cone, chart, "0", tolerance=1e-12)
    fixed = jaxrod.System(cone, jaxrod.Rotation(), gravity=GRAVITY)
    start = fixed.state(angle=START["angle"], rate=START["rate"])
    plane = jaxrod.simulate(fixed, start, ts=TIMES, tolerance=1e-12)
    assert_same_motion(space, plane, START["azimuth"])
    # Beyond the pole the rod points the other way, and the angle above the horizontal goes down again.
    np.testing.assert_allclose(np.sin(space.angle), np.sin(plane.angle), rtol=0, atol=1e-10)
    heading = (np.asarray(space.azimuth) - START["azimuth"]) % (2 * np.pi)
    want = np.where(np.cos(plane.angle) > 0, 0.0, np.pi)
    np.testing.assert_allclose((heading - want + 1) % (2 * np.pi) - 1, 0.0, rtol=0, atol=1e-10)
    assert plane.angle[0] > np.pi / 2 > START["angle"], "the run must pass the pole"


def assert_same_motion(space, plane, azimuth):
    """The tip in the vertical plane of this azimuth, and the strain, to 1e-10."""
    tip = np.asarray(space.tip)
    outward = tip[:, :2] @ [math.cos(azimuth), math.sin(azimuth)]
    across = tip[:, :2] @ [-math.sin(azimuth), math.cos(azimuth)]
    np.testing.assert_allclose(np.stack([outward, tip[:, 2]], -1), plane.tip, rtol=0, atol=1e-10)
    np.testing.assert_allclose(across, 0.0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(space.strain, plane.strain, rtol=0, atol=1e-10)


def at_the_pole(rate, azimuth=0.0):
    """Exactly there: cos(pi / 2) is 6e-17, so an angle does not get there."""
    toward = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    arrays = (np.array([0.0, 0.0, 1.0]), -rate * toward, np.zeros(1), np.zeros(1), np.zeros(()))
    return jaxrod.State(*map(jnp.asarray, arrays))


@pytest.mark.parametrize("exactly", [True, False], ids=["0, 0, 1", "pi/2"])
@pytest.mark.parametrize("chart", [jaxrod.Embedded(), jaxrod.Director()], ids=name_of)
def test_start_at_the_pole(chart, exactly, cone):
    system = jaxrod.System(cone, jaxrod.Spherical(), gravity=GRAVITY)
    rate, azimuth = 5.0, 2.0
    start = at_the_pole(rate, azimuth) if exactly else system.state(angle=math.pi / 2, rate=rate, azimuth=azimuth)
    space = jaxrod.simulate(system, start, ts=TIMES, chart=chart, tolerance=1e-12)
    fixed = jaxrod.System(cone, jaxrod.Rotation(), gravity=GRAVITY)
    plane = jaxrod.simulate(fixed, fixed.state(angle=math.pi / 2, rate=rate), ts=TIMES, tolerance=1e-12)
    assert_same_motion(space, plane, azimuth)


@pytest.mark.parametrize("chart", [jaxrod.Embedded(), jaxrod.Director()], ids=name_of)
def test_rest_at_the_pole(chart, cone):
    """Upright and at rest: all it does is to sag and bounce, eps = -s (1 - cos(omega t))."""
    system = jaxrod.System(cone, jaxrod.Spherical(), gravity=GRAVITY)
    sol = jaxrod.simulate(system, at_the_pole(rate=0.0), ts=TIMES, chart=chart)
    np.testing.assert_array_equal(sol.director, [[0.0, 0.0, 1.0]] * 2)
    np.testing.assert_array_equal(sol.angle, np.pi / 2)
    for name in ("rate", "azimuth", "azimuth_rate"):
        np.testing.assert_array_equal(getattr(sol, name), 0.0, err_msg=name)
    omega, sag = 2 * np.pi * jaxrod.natural_frequencies(system)[0], 9.81 * cone.first_moment() / cone.stiffness
    np.testing.assert_allclose(sol.strain, -sag * (1 - np.cos(omega * TIMES)), rtol=0, atol=1e-8)


def test_gradients_at_the_pole_are_finite():
    state = at_the_pole(rate=5.0)
    for name in ("angle", "rate", "azimuth", "azimuth_rate"):
        gradient = jax.grad(lambda state, name=name: getattr(state, name))(state)
        for leaf in jax.tree.leaves(gradient):
            assert np.all(np.isfinite(leaf)), name
