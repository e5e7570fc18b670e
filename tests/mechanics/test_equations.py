"""The equations of motion that autodiff finds, against equations written by hand.

Equation numbers are those of Vikhrenko, Lasovsky, Tishevich (2013).
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

import jaxrod

GRAVITY = 9.81
N = 500
CHARTS = [jaxrod.Angles(), jaxrod.Embedded(), jaxrod.Director()]
MOTIONS = [jaxrod.Rotation(), jaxrod.Spherical(), jaxrod.Flight()]


def name_of(value):
    return type(value).__name__


def random_coordinates(seed, space):
    """Coordinates psi, [phi], eps of N states away from the pole, and their rates."""
    rng = np.random.default_rng(seed)
    psi, phi, eps = rng.uniform(-1.3, 1.3, N), rng.uniform(-9, 9, N), rng.uniform(-0.6, 1.5, N)
    dpsi, dphi, deps = rng.normal(0, 10, (3, N))
    if space:
        return np.stack([psi, phi, eps], axis=-1), np.stack([dpsi, dphi, deps], axis=-1)
    return np.stack([psi, eps], axis=-1), np.stack([dpsi, deps], axis=-1)


@jax.jit
def _accelerations(lagrangian, q, v):
    return jax.vmap(lambda q, v: lagrangian.acceleration(0.0, q, v))(q, v)


def accelerations(lagrangian, q, v):
    return np.asarray(_accelerations(lagrangian, q, v))


def assert_balance(what, *terms):
    """The terms of an equation add up to zero, to 1e-12 of their sizes."""
    size = sum(np.abs(term) for term in terms)
    error = np.max(np.abs(sum(terms)) / size)
    assert error < 1e-12, f"{what}: terms leave {error:.1e} of their sizes"


@pytest.fixture(params=["cone", "paper's mixture"])
def body(request):
    """A pivoted rod, and its I, S = m x_C and C = c l0^2."""
    if request.param == "cone":
        rod = request.getfixturevalue("cone")
        return rod, float(rod.moment_of_inertia()), float(rod.first_moment()), float(rod.stiffness)
    inertia, first_moment, stiffness = 0.955, 1.194, 18849.6  # (16), arm l0/2 of (15), (14)
    return jaxrod.Lumped(inertia, first_moment, stiffness, 1.0), inertia, first_moment, stiffness


def test_equations_5(body):
    rod, I_A, S, C = body
    q, v = random_coordinates(1, space=False)
    system = jaxrod.System(rod, jaxrod.Rotation(), gravity=GRAVITY)
    ddpsi, ddeps = accelerations(system.lagrangian(jaxrod.Angles()), q, v).T
    (psi, eps), (dpsi, deps) = q.T, v.T
    # (15) with x_C for l0 / 2
    Q_psi, Q_eps = -(1 + eps) * GRAVITY * S * np.cos(psi), -GRAVITY * S * np.sin(psi) - C * eps
    assert_balance("psi", (1 + eps) ** 2 * I_A * ddpsi, 2 * (1 + eps) * I_A * dpsi * deps, -Q_psi)
    assert_balance("eps", I_A * ddeps, -(1 + eps) * I_A * dpsi**2, -Q_eps)


def test_equations_9_lack_a_square(body):
    """The second of (9) as printed has 2 (1 + eps) I_A cos psi sin psi phi' psi', where 2 (1 + eps)^2 must stand."""
    rod, I_A, S, C = body
    q, v = random_coordinates(2, space=True)
    system = jaxrod.System(rod, jaxrod.Spherical(), gravity=GRAVITY)
    ddpsi, ddphi, ddeps = accelerations(system.lagrangian(jaxrod.Angles()), q, v).T
    (psi, _, eps), (dpsi, dphi, deps) = q.T, v.T
    cos, sin, r = np.cos(psi), np.sin(psi), 1 + eps
    Q_psi, Q_eps = -r * GRAVITY * S * cos, -GRAVITY * S * sin - C * eps
    assert_balance("psi", r**2 * I_A * ddpsi, 2 * r * I_A * dpsi * deps, r**2 * I_A * cos * sin * dphi**2, -Q_psi)
    assert_balance("eps", I_A * ddeps, -r * I_A * dpsi**2, -r * I_A * cos**2 * dphi**2, -Q_eps)

    as_printed = [
        r**2 * I_A * cos**2 * ddphi,
        2 * r * I_A * cos**2 * dphi * deps,
        -2 * r * I_A * cos * sin * dphi * dpsi,
    ]
    corrected = [*as_printed[:2], -2 * r**2 * I_A * cos * sin * dphi * dpsi]
    assert_balance("phi", *corrected)
    missing = -2 * eps * r * I_A * cos * sin * dphi * dpsi
    assert_balance("phi with the missing term", *as_printed, missing)
    rest = np.abs(sum(as_printed)) / sum(np.abs(term) for term in as_printed)
    assert np.median(rest) > 1e-2, "as printed, the equation must be seen to fail"


# ---- one motion in several coordinates


def random_states(system, seed=3):
    q, v = random_coordinates(seed, space=True)
    rng = np.random.default_rng(seed + 1)
    keywords = {"angle": q[:, 0], "rate": v[:, 0], "strain": q[:, 2], "strain_rate": v[:, 2]}
    if system.motion.dimension == 3:
        keywords |= {"azimuth": q[:, 1], "azimuth_rate": v[:, 1]}
    if isinstance(system.motion, jaxrod.Flight):
        keywords |= {"center": rng.normal(size=(N, 2)), "center_velocity": rng.normal(size=(N, 2))}
    return jax.vmap(lambda keywords: system.state(**keywords))(keywords)


def physical(system, chart, state):
    """T, and the second derivatives of director, strain and centre of mass, computed in `chart`."""
    motion, lagrangian = system.motion, system.lagrangian(chart)
    q, v = chart.encode(motion, state)
    kinetic = chart.kinetic(motion, system.body, 0.0, q, v)
    if state.center_velocity is not None:
        kinetic = kinetic + jaxrod.energy.kinetic_center(system.body, state.center_velocity)

    def rate(q, v):
        return jax.jvp(lambda q: chart.place(motion, 0.0, q), (q,), (v,))[1]

    _, second = jax.jvp(rate, (q, v), (v, lagrangian.acceleration(0.0, q, v)))
    return kinetic, second


@pytest.mark.parametrize("motion", MOTIONS, ids=name_of)
def test_charts_give_one_energy_and_one_acceleration(motion, cone):
    system = jaxrod.System(cone, motion, gravity=GRAVITY)
    states = random_states(system)
    kinetic = jax.jit(jax.vmap(system.kinetic_energy))(states)
    results = jax.jit(jax.vmap(lambda state: [physical(system, chart, state) for chart in CHARTS]))(states)
    scales = [np.max(np.abs(x)) for x in jax.tree.leaves(results[0])]
    for chart, result in zip(CHARTS, results, strict=True):
        np.testing.assert_allclose(result[0], kinetic, rtol=1e-12, err_msg=f"T in {name_of(chart)}")
        for got, want, scale in zip(jax.tree.leaves(result), jax.tree.leaves(results[0]), scales, strict=True):
            np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * scale, err_msg=name_of(chart))


def test_kinetic_energies_agree(cone):
    """(4), (8), and the same without angles."""
    body = jaxrod.System(cone, jaxrod.Spherical()).body

    def energies(state):
        a, da, d, dd = state.amplitudes, state.amplitude_rates, state.direction, state.direction_rate
        return jnp.stack([
            jaxrod.energy.kinetic_spherical(body, a, da, state.angle, state.rate, state.azimuth_rate),
            jaxrod.energy.kinetic_director(body, a, da, dd),
            jaxrod.energy.kinetic_embedded(body, da[0] * d + (1 + a[0]) * dd),
            # in the vertical plane of the rod, and then across it
            jaxrod.energy.kinetic_rotation(body, a, da, state.rate)
            + jaxrod.energy.kinetic_rotation(body, a, 0 * da, state.azimuth_rate * jnp.cos(state.angle)),
        ])  # fmt: skip

    T = np.asarray(jax.jit(jax.vmap(energies))(random_states(jaxrod.System(cone, jaxrod.Spherical()))))
    np.testing.assert_allclose(T[:, 1:], T[:, :1].repeat(3, axis=1), rtol=1e-12)


# ---- Lagrangians of the user's own


def double_pendulum(t, q, v, g=9.81, length=(1.0, 0.7), m=(1.0, 0.4)):
    del t
    kinetic = (m[0] + m[1]) * (length[0] * v[0]) ** 2 / 2 + m[1] * (length[1] * v[1]) ** 2 / 2
    kinetic += m[1] * length[0] * length[1] * v[0] * v[1] * jnp.cos(q[0] - q[1])
    return kinetic + (m[0] + m[1]) * g * length[0] * jnp.cos(q[0]) + m[1] * g * length[1] * jnp.cos(q[1])


def double_pendulum_by_hand(q, v, g=9.81, length=(1.0, 0.7), m=(1.0, 0.4)):
    """Solved for the accelerations, as in textbooks; angles from the vertical."""
    (a, b), (da, db) = q, v
    M, s, c = m[0] + m[1], np.sin(a - b), np.cos(a - b)
    below = m[0] + m[1] * s**2
    dda = (-s * m[1] * (length[0] * da**2 * c + length[1] * db**2) - g * (M * np.sin(a) - m[1] * np.sin(b) * c)) / (
        length[0] * below
    )
    ddb = (s * (M * length[0] * da**2 + m[1] * length[1] * db**2 * c) + g * M * (np.sin(a) * c - np.sin(b))) / (
        length[1] * below
    )
    return np.stack([dda, ddb])


def solved(accelerate, q, v, ts):
    """q at ts, by scipy."""
    n = len(q)
    y = scipy.integrate.solve_ivp(
        lambda t, y: np.concatenate([y[n:], accelerate(t, y[:n], y[n:])]),
        (0, ts[-1]), np.concatenate([q, v]), "DOP853", t_eval=ts, rtol=1e-13, atol=1e-13,
    ).y  # fmt: skip
    return y[:n].T


def test_double_pendulum():
    rng = np.random.default_rng(5)
    q, v = rng.uniform(-3, 3, (N, 2)), rng.normal(0, 3, (N, 2))
    pendulum = jaxrod.Lagrangian(double_pendulum)
    got, want = accelerations(pendulum, q, v), double_pendulum_by_hand(q.T, v.T).T
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * np.max(np.abs(want)))

    ts, start = np.linspace(0, 3, 4), (np.array([1.5, -0.5]), np.array([0.0, 2.0]))
    sol = jaxrod.simulate(pendulum, start, ts=ts)
    reference = solved(lambda t, q, v: double_pendulum_by_hand(q, v), *start, ts)
    np.testing.assert_allclose(sol.states.q, reference, rtol=0, atol=1e-9)
    np.testing.assert_allclose(sol.energy, sol.energy[0], rtol=0, atol=1e-9 * 2 * 9.81)


def test_lagrangian_that_depends_on_time():
    """A pendulum whose pivot is shaken up and down, Y = A cos(w t): so fast that it stands upright (Kapitza)."""
    length, g, A, w = 0.5, 9.81, 0.04, 150.0

    def function(t, q, v):
        pivot_rate = -A * w * jnp.sin(w * t)
        dx, dy = length * jnp.cos(q[0]) * v[0], pivot_rate + length * jnp.sin(q[0]) * v[0]
        return (dx**2 + dy**2) / 2 + g * length * jnp.cos(q[0])

    def by_hand(t, q, v):
        return -(g - A * w**2 * np.cos(w * t)) / length * np.sin(q)

    shaken = jaxrod.Lagrangian(function)
    rng = np.random.default_rng(6)
    t, q, v = rng.uniform(0, 1, N), rng.uniform(-3, 3, (N, 1)), rng.normal(0, 5, (N, 1))
    got = jax.jit(jax.vmap(shaken.acceleration))(t, q, v)
    want = by_hand(t[:, None], q, v)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * np.max(np.abs(want)))

    ts, start = np.linspace(0, 2, 4), (np.array([3.0]), np.array([0.0]))
    sol = jaxrod.simulate(shaken, start, ts=ts)
    np.testing.assert_allclose(sol.states.q, solved(by_hand, *start, ts), rtol=0, atol=1e-9)
    assert np.all(np.abs(np.asarray(sol.states.q) - np.pi) < 0.5), "it must stay upright"


@pytest.mark.parametrize("n", [6, 7])
def test_full_mass_matrix_and_force(n):
    """Linear chains up to the size solved by hand-written Cholesky (6) and beyond: M v' = -K q + Q, by numpy."""
    rng = np.random.default_rng(n)
    half, stiffness, damping = rng.normal(size=(3, n, n))
    mass, stiffness = half @ half.T + np.eye(n), stiffness + stiffness.T
    chain = jaxrod.Lagrangian(lambda t, q, v: v @ mass @ v / 2 - q @ stiffness @ q / 2, lambda t, q, v: damping @ v)
    q, v = rng.normal(size=(2, n))
    got = jax.jit(lambda q, v: [f(0.0, q, v) for f in (chain.acceleration, chain.mass_matrix, chain.energy)])(q, v)
    acceleration = np.linalg.solve(mass, damping @ v - stiffness @ q)
    energy = v @ mass @ v / 2 + q @ stiffness @ q / 2
    for found, want in zip(got, (acceleration, mass, energy), strict=True):
        np.testing.assert_allclose(found, want, rtol=0, atol=1e-12 * np.max(np.abs(want)))
