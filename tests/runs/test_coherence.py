"""Two ways to say the same thing give the same, to 1e-10: motions, rungs, rods, charts and drives.

Accelerations are compared at random states, as the rate at which the `State` changes along the motion: then no
coordinates are left in them.
"""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from conftest import make_rod, scene

import jaxrod

GRAVITY = 9.81
N = 30
HEAVY = {"tip_mass": 0.3, "tip_inertia": 0.01}


def assert_same(got, want, tolerance=1e-10, what=""):
    """Leaf by leaf, by the largest number of each leaf."""
    pairs = zip(jax.tree.leaves(got), jax.tree.leaves(want), strict=True)
    for k, (a, b) in enumerate((np.asarray(a), np.asarray(b)) for a, b in pairs):
        assert np.all(np.isfinite(a)), f"{what}: leaf {k} is not finite"
        np.testing.assert_allclose(
            a, b, rtol=0, atol=tolerance * max(np.max(np.abs(b), initial=0), 1e-300), err_msg=what
        )


def numbers(n, seed=1):
    """Time, angle, rate, azimuth, azimuth_rate, and n strains and their rates, of N states."""
    rng = np.random.default_rng(seed)
    t, angle, azimuth = rng.uniform(0, 1, N), rng.uniform(-1.2, 1.2, N), rng.uniform(-3, 3, N)
    rate, azimuth_rate = rng.normal(0, 20, (2, N))
    strains = {"amplitudes": rng.uniform(-0.1, 0.1, (N, n)), "amplitude_rates": rng.normal(0, 10, (N, n))}
    return t, {"angle": angle, "rate": rate, **strains}, {"azimuth": azimuth, "azimuth_rate": azimuth_rate}


def growth(system, chart, t, state):
    """d/dt of a state: its velocities and accelerations."""
    equations = system.equations(chart)
    q, v = equations.encode(t, state)
    along = (jnp.ones_like(t), v, equations.acceleration(t, q, v))
    return jax.jvp(equations.decode, (t, q, v), along)[1]


def over_states(function, *states):
    """One program for N states."""
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(function))(*states))


# ---- a motion in space that stays in a vertical plane is the motion in the plane

BASES = {"Ritz(1)": jaxrod.Ritz(1), "Ritz(3)": jaxrod.Ritz(3), "ForceRitz(3)": jaxrod.ForceRitz(3)}


def lifted(vector, azimuth):
    """A vector of the plane in the vertical plane of this azimuth."""
    return jnp.stack([vector[0] * jnp.cos(azimuth), vector[0] * jnp.sin(azimuth), vector[1]])


@pytest.mark.parametrize("basis", BASES.values(), ids=BASES)
def test_planar_motion_is_spherical_motion_confined(basis):
    """Accelerations, with forces: a moment about the axis across the plane, friction and a pull on the tip."""

    def both(t, given, azimuth):
        across = jnp.stack([jnp.sin(azimuth), -jnp.cos(azimuth), jnp.zeros(())])  # from outward to up
        rubbing = [jaxrod.PivotFriction(0.3), jaxrod.TipForce(40.0), jaxrod.KelvinVoigt(1e-3)]
        torques = [jaxrod.Torque(5.0)], [jaxrod.Torque(5.0 * across)]
        pull = jnp.array([20.0, -10.0])
        pulls = [jaxrod.TipForce(pull)], [jaxrod.TipForce(lifted(pull, azimuth))]
        motions = jaxrod.Rotation(0.3), jaxrod.Spherical(0.3)
        plane, space = (
            scene(motion, basis, GRAVITY, rubbing + torque + tip, **HEAVY)
            for motion, torque, tip in zip(motions, torques, pulls, strict=True)
        )
        flat = growth(plane, jaxrod.Angles(), t, plane.state(**given))
        turned = growth(space, jaxrod.Director(), t, space.state(**given, azimuth=azimuth))
        want = lifted(flat.direction_rate, azimuth), flat.amplitude_rates
        return want, (turned.direction_rate, turned.amplitude_rates)

    t, given, more = numbers(basis.n)
    want, got = over_states(both, t, given, more["azimuth"])
    assert_same(got, want)


@pytest.mark.slow
@pytest.mark.parametrize("basis", [BASES["Ritz(3)"], BASES["ForceRitz(3)"]], ids=["Ritz", "ForceRitz"])
def test_a_planar_run_is_a_spherical_run(basis):
    """A quarter of a second, past the pole; `Ritz(1)` is run in test_charts."""
    ts, azimuth, given = np.array([0.1, 0.25]), 0.5, {"angle": 0.9, "rate": 12.0, "strain": 0.02}
    plane, space = (scene(motion, basis, GRAVITY) for motion in (jaxrod.Rotation(), jaxrod.Spherical()))
    flat = jaxrod.simulate(plane, plane.state(**given), ts=ts, tolerance=1e-12).states
    turned = jaxrod.simulate(space, space.state(**given, azimuth=azimuth), ts=ts, tolerance=1e-12).states
    want = jax.vmap(lambda d: lifted(d, azimuth))(flat.direction)
    assert_same((turned.direction, turned.amplitudes), (want, flat.amplitudes))
    assert flat.angle[-1] > np.pi / 2


# ---- a rung contains the rungs below it

PIVOT = 0.55


def stepped():
    steps = jaxrod.PiecewiseConstant([0.35], [2e-3, 1e-3])
    return make_rod(section=steps, young=jaxrod.PiecewiseConstant([0.35], [1e7, 3e7]), tip_mass=0.3)


@pytest.mark.parametrize("kind", [jaxrod.Ritz, jaxrod.ForceRitz])
@pytest.mark.parametrize(
    "where",
    ["steps and a pivot", *(pytest.param(x, marks=pytest.mark.slow) for x in ("cone at its root", "steps in flight"))],
)
def test_a_rung_contains_the_one_below(kind, where):
    """Projections are leading blocks, and a state of the lower rung has, with zeros appended, the same energies."""
    made, highest = (make_rod(), 4) if where.startswith("cone") else (stepped(), 7)
    motion = {"root": jaxrod.Rotation(), "pivot": jaxrod.Rotation(PIVOT), "flight": jaxrod.Flight()}[where.split()[-1]]
    rng = np.random.default_rng(2)
    a, da = rng.uniform(-0.05, 0.05, highest), rng.normal(0, 5, highest)
    rungs = (1, 2, 4, 7) if highest == 7 else (1, 2, 3, 4)

    @jax.jit
    def all_rungs(a, da):
        found = []
        for n in rungs:
            system = scene(motion, kind(n), GRAVITY, rod=made)
            place = {"center": (0.2, 0.3)} if where.endswith("flight") else {}
            keep = np.arange(n) < rungs[0]
            state = system.state(angle=0.4, rate=9.0, amplitudes=a[:n] * keep, amplitude_rates=da[:n] * keep, **place)
            energies = [system.kinetic_energy(state), system.elastic_energy(state), system.gravity_energy(state)]
            body = system.body
            found.append((body.mass_matrix, body.stiffness_matrix, body.first_moments, body.tip, jnp.stack(energies)))
        return found

    found = [jax.tree.map(np.asarray, one) for one in all_rungs(a, da)]
    for lower, (mass, stiffness, moments, tip, energies) in itertools.pairwise(found):
        n = len(lower[1])
        blocks = mass[: n + 1, : n + 1], stiffness[:n, :n], tip[: n + 1], energies
        assert_same(blocks, (lower[0], lower[1], lower[3], lower[4]), what=f"n = {n}")
        # in flight the first moments are zero
        np.testing.assert_allclose(moments[: n + 1], lower[2], rtol=0, atol=1e-10 * mass[0, 0], err_msg=f"n = {n}")
    largest = found[-1][1].shape[0]
    assert largest == highest and np.linalg.eigvalsh(found[-1][0][1:, 1:])[0] > 0, "no shape is empty or given twice"


# ---- steps that are none


@pytest.mark.slow
def test_equal_steps_are_no_steps():
    """What must agree with the plain rod: all that knows no pieces.

    Mass properties, the exact frequencies, and the first rung, uniform strain or constant force.  From the second on
    shapes live on pieces: d of them on each contain the d shapes of the plain rod, so that the frequencies are lower;
    and the rungs of both converge to the same ones.
    """
    area = np.pi * 0.025**2
    plain = make_rod(section=jaxrod.Uniform(0.025), tip_mass=0.3)
    equal = [jaxrod.PiecewiseConstant([s], [x, x]) for s, x in ((0.3, area), (0.3, 1e7), (0.6, 1200.0))]
    pieces = jaxrod.Rod(1.0, *equal, tip_mass=0.3)
    assert pieces.breaks == (0.3, 0.6)

    @jax.jit
    def read():
        found = []
        for made in (plain, pieces):
            system = scene(rod=made)
            numbers = made.mass, made.center_of_mass, made.moment_of_inertia(), made.stiffness, made.wave_speed
            firsts = [kind(1).project(made) for kind in (jaxrod.Ritz, jaxrod.ForceRitz)]
            blocks = [(body.mass_matrix, body.stiffness_matrix, body.first_moments, body.tip) for body in firsts]
            found.append((numbers, blocks, jaxrod.continuum.natural_frequencies(system, 3)))
        rungs = [(plain, jaxrod.Ritz(2)), (pieces, jaxrod.Ritz(6)), (plain, jaxrod.Ritz(10)), (pieces, jaxrod.Ritz(18))]
        return found, [jaxrod.natural_frequencies(scene(basis=rung, rod=made)) for made, rung in rungs]

    (want, got), (coarse, within, fine, finer) = jax.tree.map(np.asarray, read())
    assert_same(got, want)
    assert np.all(within[:2] < coarse * (1 - 1e-6))
    np.testing.assert_allclose(fine[:2], want[2][:2], rtol=1e-10)
    np.testing.assert_allclose(finer[:2], want[2][:2], rtol=1e-10)


# ---- flight without spin is the free linear rod


@pytest.mark.slow
def test_flight_without_spin_is_the_free_rod():
    """The rungs' frequencies converge to the exact ones, which are of both free ends; a mode is a cosine."""
    fine, system = (scene(jaxrod.Flight(), jaxrod.Ritz(n)) for n in (12, 3))

    @jax.jit
    def read():
        return jaxrod.natural_frequencies(fine), jaxrod.natural_frequencies(system), system.body

    many, three, body = read()
    np.testing.assert_allclose(many[:2], jaxrod.continuum.natural_frequencies(fine, 2), rtol=1e-10)
    squares, shapes = scipy.linalg.eigh(np.asarray(body.stiffness_matrix), np.asarray(body.strain_mass))
    np.testing.assert_allclose(three, np.sqrt(squares) / (2 * np.pi), rtol=1e-12)
    mode, omega = 0.1 * shapes[:, 1] / np.max(np.abs(shapes[:, 1])), np.sqrt(squares[1])
    ts = 2 * np.pi / omega * np.array([0.3, 1.0, 3.3])
    start = system.state(angle=0.7, amplitudes=mode, center=(1.0, 2.0), center_velocity=(3.0, 0.0))
    sol = jaxrod.simulate(system, start, ts=ts, tolerance=1e-12)
    np.testing.assert_allclose(sol.states.amplitudes, np.cos(omega * ts)[:, None] * mode, rtol=0, atol=1e-11)
    np.testing.assert_allclose(sol.angle, 0.7, rtol=0, atol=1e-14)


# ---- a drive


def swaying(t):
    return 0.7 + 3.0 * t + 0.4 * jnp.sin(5 * t)


@pytest.mark.parametrize("basis", [jaxrod.Ritz(3)], ids=["Ritz(3)"])
def test_a_drive_is_the_torque_that_it_asks_for(basis):
    """Driven, and turned freely by the torque of that drive: the strain does the same, the angle what it is told."""
    load = [jaxrod.PivotFriction(0.3), jaxrod.TipForce([20.0, -10.0]), jaxrod.KelvinVoigt(1e-3)]
    driven = scene(jaxrod.Driven(swaying, pivot=0.3), basis, GRAVITY, load, **HEAVY)
    motor = jaxrod.Torque(lambda t, state: driven.drive_torque(t, state))
    free = scene(jaxrod.Rotation(0.3), basis, GRAVITY, [*load, motor], **HEAVY)

    def both(t, amplitudes, amplitude_rates):
        angle, rate, acceleration = driven.motion.turning(t)
        q, v = driven.equations(jaxrod.Strains()).encode(
            t, driven.state(amplitudes=amplitudes, amplitude_rates=amplitude_rates)
        )
        strain = driven.equations(jaxrod.Strains()).acceleration(t, q, v)
        q, v = jnp.concatenate([angle[None], amplitudes]), jnp.concatenate([rate[None], amplitude_rates])
        turning = free.equations(jaxrod.Angles()).acceleration(t, q, v)
        return (acceleration, strain), (turning[0], turning[1:])

    t, given, _ = numbers(basis.n)
    want, got = over_states(both, t, given["amplitudes"], given["amplitude_rates"])
    assert_same(got, want)
    np.testing.assert_allclose(want[0], -10.0 * np.sin(5 * t), rtol=1e-12)


def test_a_steady_drive_is_free_turning():
    """The strain's acceleration does not ask who keeps the rate; for uniform strain it is W^2 (1 + e) - k e."""
    basis, spin = jaxrod.Ritz(2), 17.0
    driven = scene(jaxrod.Driven(lambda t: spin * t), basis)
    free = scene(basis=basis)

    def both(t, amplitudes, rates):
        q, v = jnp.concatenate([(spin * t)[None], amplitudes]), jnp.concatenate([jnp.array([spin]), rates])
        prescribed = driven.equations(jaxrod.Strains()).acceleration(t, amplitudes, rates)
        return prescribed, free.equations(jaxrod.Angles()).acceleration(t, q, v)[1:]

    t, given, _ = numbers(2)
    want, got = over_states(both, t, given["amplitudes"], given["amplitude_rates"])
    assert_same(got, want)
    one = scene(jaxrod.Driven(lambda t: spin * t))
    e, k = given["amplitudes"][:, 0], (2 * np.pi * float(jaxrod.natural_frequencies(one)[0])) ** 2

    def uniform(t, e):
        return one.equations(jaxrod.Strains()).acceleration(t, e[None], jnp.zeros(1))[0]

    assert_same(over_states(uniform, t, e), spin**2 * (1 + e) - k * e)


# ---- charts

MOTIONS = {"plane": jaxrod.Rotation(0.3), "space": jaxrod.Spherical(0.3), "flight": jaxrod.Flight()}


def every_force(motion):
    """All forces that a motion can have, their strengths functions of time and state."""
    space, numbers = motion.dimension == 3, jnp.arange(1.0, 4.0)
    moment = numbers if space else 2.0
    given = [
        jaxrod.Torque(lambda t, state: moment * (jnp.sin(3 * t) + state.direction_rate[0])),
        jaxrod.TipForce(lambda t, state: 30.0 * state.direction[-1]),
        jaxrod.TipForce(lambda t, state: numbers[: motion.dimension] * (1 + t)),
        jaxrod.KelvinVoigt(1e-3),
    ]
    if isinstance(motion, jaxrod.Flight):
        return given
    shaker = jaxrod.ShakenBase(lambda t: 0.02 * jnp.cos(numbers[: motion.dimension] * 10 * t))
    return [*given, jaxrod.PivotFriction(lambda t, state: 0.3 + 0.1 * t), shaker]


SLOW = [("plane", 0), ("plane", 1), ("flight", 0), ("flight", 3)]  # the others have what they have


@pytest.mark.parametrize(
    "motion, n",
    [
        pytest.param(motion, n, id=f"{name}, {n}", marks=[pytest.mark.slow] * ((name, n) in SLOW))
        for name, motion in MOTIONS.items()
        for n in (0, 1, 3)
    ],
)
@pytest.mark.filterwarnings("ignore:KelvinVoigt:UserWarning")  # of the rigid rod
def test_charts_give_one_acceleration(motion, n):
    """With every force and a body at the tip; with one strain and no inertia of that body's, `Embedded` too."""
    bodies = [make_rod(**HEAVY)] if n != 1 else [make_rod(**HEAVY), make_rod(tip_mass=0.3)]
    charts = [[jaxrod.Angles(), jaxrod.Director()], [jaxrod.Angles(), jaxrod.Embedded()]]

    def all_charts(t, given):
        found = []
        for made, each in zip(bodies, charts, strict=False):
            system = scene(motion, jaxrod.Ritz(n), GRAVITY, every_force(motion), rod=made)
            state = system.state(**given)
            found.append([growth(system, chart, t, state) for chart in each])
        return found

    t, given, more = numbers(n)
    if motion.dimension == 3:
        given |= more
    if isinstance(motion, jaxrod.Flight):
        given |= {"center": np.ones((N, 2)), "center_velocity": np.full((N, 2), 3.0)}
    for first, second in over_states(all_charts, t, given):
        assert_same(second, first)


# ---- static strain in closed form


def test_static_uniform_strain_by_hand(cone):
    """(k - psi'^2) r = k - gamma sin psi, and p = I r^2 psi' changes at the rate -gamma I r cos psi.

    With r = 1 + strain, k the square of the axial frequency and gamma = S g / I.
    """
    system = scene(basis=jaxrod.QuasiStatic(jaxrod.Ritz(1)), gravity=GRAVITY)
    inertia = float(cone.moment_of_inertia())
    k, gamma = float(cone.stiffness) / inertia, float(cone.first_moment()) * GRAVITY / inertia
    rng = np.random.default_rng(3)
    psi, rate = rng.uniform(-3, 3, N), rng.uniform(-0.8, 0.8, N) * np.sqrt(k)

    def momentum(t, psi, rate):
        equations = system.equations(jaxrod.Angles())
        q, v = psi[None], rate[None]

        def p(q, v):
            state = equations.decode(t, q, v)
            return system.angular_momentum(state), state.strain

        return jax.jvp(p, (q, v), (v, equations.acceleration(t, q, v)))

    (p, strain), (dp, _) = over_states(momentum, np.zeros(N), psi, rate)
    r = (k - gamma * np.sin(psi)) / (k - rate**2)
    np.testing.assert_allclose(1 + strain, r, rtol=1e-12)
    assert_same(p, inertia * r**2 * rate)
    assert_same(dp, -gamma * inertia * r * np.cos(psi))


# ---- nothing, said in words


def test_nothing_is_nothing():
    """A body of no mass at the tip, gravity as a vector, and a pivot at the root: the same accelerations.

    A pivot that is only later known to be the root leaves a piece of no length, whose shapes are at rest: of the four
    on both pieces (constants, then degree one) the first and the last are those of `Ritz(2)`.
    """
    plain = {"basis": jaxrod.Ritz(2), "gravity": GRAVITY, "rod": make_rod()}
    same = [
        plain | {"rod": make_rod(tip_mass=0.0)},
        plain | {"rod": make_rod(tip_mass=0.0, tip_inertia=0.0)},
        plain | {"gravity": [0.0, -GRAVITY]},
        plain | {"motion": jaxrod.Rotation(pivot=0.0)},
        plain | {"motion": jaxrod.Rotation(None)},
    ]

    @jax.jit
    def all_of(pivot, t, given):
        traced = {"motion": jaxrod.Rotation(pivot), "basis": jaxrod.Ritz(4), "gravity": GRAVITY}
        padded = {k: x if x.ndim == 1 else jnp.stack([x[:, 0], 0 * t, 0 * t, x[:, 1]], 1) for k, x in given.items()}

        def over(said, t, given):
            system = scene(**said)
            return jax.vmap(lambda t, given: growth(system, jaxrod.Angles(), t, system.state(**given)))(t, given)

        return [over(said, t, given) for said in (plain, *same)], over(traced, t, padded)

    t, given, _ = numbers(2)
    (want, *found), traced = jax.tree.map(np.asarray, all_of(0.0, t, given))
    for k, got in enumerate(found):
        assert_same(got, want, 1e-13, f"scene {k}")
    resting = traced.amplitude_rates[:, 1:3]
    np.testing.assert_allclose(resting, 0.0, rtol=0, atol=1e-12 * np.max(np.abs(want.amplitude_rates)))
    outer = {name: getattr(traced, name)[:, ::3] for name in ("amplitudes", "amplitude_rates")}
    assert_same(dataclasses.replace(traced, **outer), want)


# ---- mass matrices inverted by hand


@pytest.mark.parametrize("n", [0, 1, pytest.param(2, marks=pytest.mark.slow), 4])
def test_closed_forms_invert_the_mass_matrix(n):
    """`chart.solve` of every chart against d^2 L / dv^2 by automatic differentiation."""
    spin = jnp.array(5.0)
    level, tilted = jnp.array([0.6, 0.8]), jnp.array([0.48, 0.64, 0.6])
    charts = {
        "plane": [jaxrod.Angles(), jaxrod.Director(), jaxrod.Local(level, spin)],
        "space": [jaxrod.Angles(), jaxrod.Director(), jaxrod.Local(tilted, spin)],
        "flight": [jaxrod.Angles(), jaxrod.Director()],
        "driven": [jaxrod.Strains()],
    }
    motions = {**MOTIONS, "driven": jaxrod.Driven(swaying, pivot=0.3)}
    scenes = [(make_rod(**HEAVY), motions[name], chart) for name, each in charts.items() for chart in each]
    if n == 1:
        scenes += [(make_rod(tip_mass=0.3), motion, jaxrod.Embedded()) for motion in MOTIONS.values()]

    @jax.jit
    def products():
        found = []
        for k, (made, motion, chart) in enumerate(scenes):
            system = scene(motion, jaxrod.Ritz(n), rod=made)
            equations = system.equations(chart)
            size = chart.size(motion) + (n if not isinstance(chart, jaxrod.Embedded) else 0)
            size += 2 * isinstance(motion, jaxrod.Flight)
            q, v = np.random.default_rng(k).uniform(0.1, 0.4, (2, size))
            mass = system.lagrangian(chart).mass_matrix(0.3, jnp.asarray(q), jnp.asarray(v))
            inverse = jax.vmap(lambda right, q=q, equations=equations: equations.solve(0.3, jnp.asarray(q), right))
            found.append(inverse(mass))  # symmetric
        return found

    for (_, motion, chart), product in zip(scenes, products(), strict=True):
        name = f"{type(chart).__name__} of {type(motion).__name__}"
        np.testing.assert_allclose(product, np.eye(len(product)), rtol=0, atol=1e-12, err_msg=name)


def test_static_strain_under_a_force_that_depends_on_it(uniform):
    """A spring at the tip, F = -5000 strain: (C + 5000 - I w^2) a = I w^2 - S g sin psi, and its equilibrium hanging."""
    spring = jaxrod.TipForce(lambda t, state: -5000.0 * state.strain)
    basis = jaxrod.QuasiStatic(jaxrod.Ritz(1))
    system = scene(basis=basis, gravity=9.81, forces=[spring], rod=uniform)
    strain = system.equations(jaxrod.Angles()).strain(0.1, jnp.array([0.4]), jnp.array([20.0]))[0]
    inertia, moment, stiffness = uniform.moment_of_inertia(), uniform.first_moment(), uniform.stiffness
    load = inertia * 400 - moment * 9.81 * jnp.sin(0.4)
    assert float(strain) == pytest.approx(float(load / (stiffness + 5000 - inertia * 400)), rel=1e-12)


def test_a_rigid_driven_rod(uniform):
    """No coordinate is left: the run is the drive, its torque I psi'', and there are no modes."""
    system = scene(jaxrod.Driven(lambda t: 40.0 * t**2), jaxrod.Ritz(0), rod=uniform)
    sol = jaxrod.simulate(system, system.state(), ts=jnp.array([0.1, 0.2]))
    np.testing.assert_allclose(sol.angle, [0.4, 1.6], rtol=1e-14)
    torque = system.drive_torque(0.2, sol.states[-1])
    np.testing.assert_allclose(torque, 80 * uniform.moment_of_inertia(), rtol=1e-13)
    steady = scene(jaxrod.Driven(lambda t: 40.0 * t), jaxrod.Ritz(0), rod=uniform)
    assert jaxrod.modes(steady).frequency.shape == (0,)


def test_a_traced_pivot_at_the_root_is_none(uniform):
    """What a side of no length would add is rounding, and stays empty: the first two shapes are those without it."""

    def frequencies(pivot, n):
        return jaxrod.natural_frequencies(scene(jaxrod.Rotation(pivot), jaxrod.LoadRitz(n), rod=uniform))

    traced = jax.jit(lambda pivot: frequencies(pivot, 4))(0.0)
    np.testing.assert_allclose(traced[:2], frequencies(0.0, 2), rtol=1e-12)
    assert np.all(np.isinf(traced[2:]))
    assert jaxrod.natural_frequencies(scene(basis=jaxrod.ForceRitz(0), rod=uniform)).shape == (0,)


@pytest.mark.parametrize(
    "kind", ["lumped", *(pytest.param(x, marks=pytest.mark.slow) for x in ("uniform strain", "flight", "many shapes"))]
)
def test_many_states_give_what_few_give(kind):
    """Of a system known to the compiler: XLA:CPU once got known equal moments wrong over 2500 lanes."""
    system = {
        "lumped": jaxrod.paper.literal,
        "uniform strain": lambda: scene(gravity=GRAVITY),
        "flight": lambda: scene(jaxrod.Flight(), gravity=GRAVITY, law=jaxrod.law.neo_hookean),
        "many shapes": lambda: scene(jaxrod.Rotation(pivot=0.3), jaxrod.LoadRitz(3), GRAVITY),
    }[kind]()
    rng, many, n = np.random.default_rng(3), 5000, system.basis.n

    def of_numbers(quantity):
        return lambda angle, rate, amplitudes, amplitude_rates: quantity(
            system.state(angle=angle, rate=rate, amplitudes=amplitudes, amplitude_rates=amplitude_rates)
        )

    quantities = (  # each a program of its own: what is computed once for two is fused otherwise
        system.energy, system.kinetic_energy, system.tip, system.angular_momentum,
        lambda state: growth(system, jaxrod.Director(), 0.0 * state.turns, state),
    )  # fmt: skip
    drawn = (
        rng.uniform(-1.2, 1.2, many), rng.normal(0, 20, many),
        rng.uniform(-0.1, 0.1, (many, n)), rng.normal(0, 10, (many, n)),
    )  # fmt: skip
    some = slice(1000, 1000 + N)
    for quantity in quantities:
        got = jax.tree.map(lambda x: x[some], over_states(of_numbers(quantity), *drawn))
        assert_same(got, over_states(of_numbers(quantity), *(x[some] for x in drawn)), 1e-12, "5000 against 30")
