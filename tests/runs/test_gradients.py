"""Derivatives of end states and frequencies: reverse mode, forward mode and central differences agree."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import make_rod, scene

import jaxrod

# What is differentiated by, and the size of a change that matters
SCALES = {
    "young": 1e7, "density": 1200.0, "root_radius": 0.02, "tip_radius": 0.03, "length": 1.0, "gravity": 9.81,
    "angle": 1.0, "rate": 10.0, "strain": 0.1, "extra": 5.0,
}  # fmt: skip
NAMES = tuple(SCALES)
SCALE = np.array(list(SCALES.values()))
MOTIONS = {"Rotation": jaxrod.Rotation(), "Spherical": jaxrod.Spherical(), "Flight": jaxrod.Flight()}
EXTRA = {"Rotation": "strain_rate", "Spherical": "azimuth_rate", "Flight": "center_velocity"}
DURATION = 0.3  # s: seven axial periods

HANGING = {"angle": -np.pi / 2, "rate": 0.0, "strain": None, "extra": 0.0}  # strain=None: that of equilibrium
WEIGHTLESS = {"gravity": 0.0, "rate": 0.0, "strain": 0.0, "extra": 0.0}
POINTS = {
    ("Rotation", "somewhere"): {},
    ("Rotation", "unstretched"): {"strain": 0.0, "extra": 0.0},
    ("Rotation", "hanging at rest"): HANGING,
    ("Rotation", "weightless at rest"): WEIGHTLESS,
    ("Spherical", "somewhere"): {},
    ("Spherical", "unstretched"): {"strain": 0.0},
    ("Spherical", "hanging at rest"): HANGING,
    ("Spherical", "weightless at rest"): WEIGHTLESS,
    ("Spherical", "starting at the pole"): {"angle": np.pi / 2},
    ("Spherical", "starting exactly at the pole"): {"angle": np.pi / 2, "extra": 0.0},
    ("Spherical", "passing through the pole"): {"angle": 1.2, "rate": 9.0, "extra": 0.0},
    ("Flight", "somewhere"): {},
    ("Flight", "unstretched"): {"strain": 0.0},
    ("Flight", "weightless at rest"): WEIGHTLESS,
}


def _rod(young, density, root_radius, tip_radius, length):
    return jaxrod.Rod(length, jaxrod.Cone(root_radius, tip_radius), young, density)


def _end(kind, numbers, at_pole, **keywords):
    """Angle, strain and tip after 0.3 s, from the numbers of `SCALES`."""
    *rod, gravity, angle, rate, strain, extra = numbers
    system = scene(MOTIONS[kind], gravity=gravity, rod=_rod(*rod))
    more = {EXTRA[kind]: jnp.stack([extra, 2 * extra]) if kind == "Flight" else extra}
    start = system.state(angle=angle, rate=rate, strain=strain, **more)
    if kind == "Spherical":  # cos(pi/2) is 6e-17 in floating point: to start at zero takes more than an angle
        direction = jnp.where(at_pole, jnp.array([0.0, 0.0, 1.0]), start.direction)
        start = eqx.tree_at(lambda s: s.direction, start, direction)
    sol = jaxrod.simulate(system, start, t1=DURATION, **keywords)
    return jnp.concatenate([sol.angle, sol.strain, sol.tip[0]])


@functools.cache
def _compiled(kind):
    """Reverse and forward derivatives, and values for differences: one program each for all points of a motion."""
    best = functools.partial(_end, kind, tolerance=1e-12)
    return (
        jax.jit(jax.jacrev(functools.partial(_end, kind))),
        jax.jit(jax.jacfwd(functools.partial(_end, kind, adjoint=diffrax.ForwardMode()))),
        jax.jit(best),
    )


@functools.cache
def _derivatives(kind, point):
    """d end / d (number / its scale) by three roads, each (outputs, numbers)."""
    given = {
        "young": 1e7, "density": 1200.0, "root_radius": 0.02, "tip_radius": 0.03, "length": 1.0, "gravity": 9.81,
        "angle": 0.3, "rate": 10.0, "strain": 0.05, "extra": 4.0,
    } | POINTS[kind, point]  # fmt: skip
    if given["strain"] is None:
        rod = _rod(*(given[name] for name in NAMES[:5]))
        given["strain"] = float(given["gravity"] * rod.first_moment() / rod.stiffness)
    numbers = jnp.array([given[name] for name in NAMES])
    at_pole = jnp.array(point == "starting exactly at the pole")
    reverse, forward, values = _compiled(kind)
    # Central differences, improved by Richardson: errors of order step^4 and 1e-13 / step
    step, size = 3e-4, SCALE.size
    stencil = jnp.concatenate([k * step * jnp.diag(SCALE) for k in (1, -1, 2, -2)])
    up, down, up2, down2 = np.reshape([values(numbers + row, at_pole) for row in stencil], (4, size, -1))
    differences = (8 * (up - down) - (up2 - down2)).T / (12 * step)
    return *(np.asarray(jac(numbers, at_pole)) * SCALE for jac in (reverse, forward)), differences


def _rows(kind, point):
    """The outputs that are smooth there: hanging in space the angle is |tilt| - pi/2, which has no derivative."""
    return slice(1, None) if (kind, point) == ("Spherical", "hanging at rest") else slice(None)


def _slow_in_space_and_flight(kind, point):
    return pytest.param(kind, point, marks=() if kind == "Rotation" else pytest.mark.slow)


@pytest.mark.parametrize(("kind", "point"), [_slow_in_space_and_flight(*x) for x in POINTS], ids=lambda x: x)
def test_end_states(kind, point):
    reverse, forward, differences = _derivatives(kind, point)
    assert np.isfinite(reverse).all() and np.isfinite(forward).all()
    rows = _rows(kind, point)
    size = np.abs(differences).max(axis=1, keepdims=True)  # zero for a motion that stays in its plane
    size = np.maximum(np.abs(differences), np.maximum(0.1 * size, 1e-2))
    np.testing.assert_array_less((np.abs(reverse - forward) / size)[rows], 1e-9)
    np.testing.assert_array_less((np.abs(reverse - differences) / size)[rows], 1e-7)


@pytest.mark.parametrize(("kind", "point"), [_slow_in_space_and_flight(*x) for x in POINTS], ids=lambda x: x)
def test_scale_identities(kind, point):
    """Motion knows E and rho by their ratio alone, and radii by theirs: E d/dE + rho d/drho = 0 = r d/dr + R d/dR."""
    by = dict(zip(NAMES, _derivatives(kind, point)[0][_rows(kind, point)].T, strict=True))
    for one, other in (("young", "density"), ("root_radius", "tip_radius")):
        size = max(1e-3, np.abs(by[one]).max())
        np.testing.assert_allclose(by[one] + by[other], 0.0, rtol=0, atol=1e-9 * size)


def test_hanging_at_rest_in_closed_form():
    """About equilibrium small swings and strains are harmonic: the derivatives are their cosines and sines."""
    rod = make_rod()
    inertia, moment, stiffness = (float(x) for x in (rod.moment_of_inertia(), rod.first_moment(), rod.stiffness))
    by = dict(zip(NAMES, (_derivatives("Rotation", "hanging at rest")[0] / SCALE).T, strict=True))
    axial = np.sqrt(stiffness / inertia)
    swing = np.sqrt(9.81 * moment / inertia / (1 + 9.81 * moment / stiffness))
    np.testing.assert_allclose(by["angle"][0], np.cos(swing * DURATION), rtol=1e-8)
    np.testing.assert_allclose(by["rate"][0], np.sin(swing * DURATION) / swing, rtol=1e-8)
    np.testing.assert_allclose(by["strain"][1], np.cos(axial * DURATION), rtol=1e-8)
    np.testing.assert_allclose(by["extra"][1], np.sin(axial * DURATION) / axial, rtol=1e-8)
    np.testing.assert_allclose(by["gravity"][1], moment / stiffness * (1 - np.cos(axial * DURATION)), rtol=1e-8)
    np.testing.assert_allclose([by["angle"][1], by["rate"][1], by["strain"][0], by["gravity"][0]], 0.0, atol=1e-12)


def test_weightless_at_rest_in_closed_form():
    """Without weight and motion nothing happens: the angle keeps, a rate adds up, gravity begins to turn the rod."""
    rod = make_rod()
    turning = -float(rod.first_moment() / rod.moment_of_inertia()) * np.cos(0.3) * DURATION**2 / 2
    by = dict(zip(NAMES, _derivatives("Rotation", "weightless at rest")[0][0] / SCALE, strict=True))
    expected = dict.fromkeys(NAMES, 0.0) | {"angle": 1.0, "rate": DURATION, "gravity": turning}
    np.testing.assert_allclose(
        [by[name] * SCALES[name] for name in NAMES], [expected[n] * SCALES[n] for n in NAMES], atol=1e-9
    )


def test_angle_at_the_pole_has_finite_derivatives():
    """Angle, azimuth and their rates of a state exactly at the pole: zero or a one-sided value, never NaN."""

    def outputs(direction, rate):
        zero = jnp.zeros(0)
        state = jaxrod.State(direction, rate, zero, zero, jnp.zeros(()))
        return jnp.stack([state.angle, state.azimuth, state.rate, state.azimuth_rate])

    for pole in (1.0, -1.0):
        at = jnp.array([0.0, 0.0, pole]), jnp.array([3.0, 0.0, 0.0])
        values, derivatives = outputs(*at), jax.jacrev(outputs, argnums=(0, 1))(*at)
        np.testing.assert_allclose(values, [pole * np.pi / 2, 0.0, -3.0 * pole, 0.0], atol=1e-15)
        assert all(np.isfinite(x).all() for x in derivatives)


EVEN, UNEVEN = [0.2, 0.3, 0.4, 0.5], [0.3, 0.34, 0.5]


class _Push(eqx.Module):
    """A force on the tip that grows with time and leans on the direction."""

    growth: jax.Array

    def __call__(self, t, state):
        return self.growth * jnp.stack([t, state.direction[0]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "ts"),
    [("loaded", UNEVEN), ("loaded, uniform", EVEN), ("driven", EVEN), ("driven", UNEVEN), ("flight", UNEVEN)],
)
def test_later_starts_save_times_and_loads(kind, ts):
    """From t0 = 0.2, by modulus, load or drive and the start's strain; all saved states count."""
    ts = jnp.array(ts)

    def outputs(p, adjoint=None):
        basis = jaxrod.Ritz(1 if "uniform" in kind else 2)
        forces = [jaxrod.TipForce(_Push(30 * p[1]))] if "loaded" in kind else []
        motion = {"driven": jaxrod.scenes.steady(20 * p[1]), "flight": jaxrod.Flight()}.get(kind)
        system = scene(motion, basis, 9.81, forces, young=1e7 * p[0])
        moving = {} if kind == "driven" else {"angle": 0.3, "rate": 8.0 * p[1]}
        start = system.state(**moving, strain=0.02 * p[2])
        sol = jaxrod.simulate(system, start, t0=0.2, ts=ts, adjoint=adjoint)
        return jnp.concatenate([sol.tip.ravel(), sol.strain_rate])

    at = jnp.ones(3)
    reverse = jax.jit(jax.jacrev(outputs))(at)
    forward = jax.jit(jax.jacfwd(functools.partial(outputs, adjoint=diffrax.ForwardMode())))(at)
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-8 * np.abs(forward).max())
    assert np.all(np.abs(forward).max(axis=0) > 1e-4)


# ---- frequencies


def _frequencies(kind, numbers):
    system = scene(MOTIONS[kind], rod=_rod(*numbers))
    return jnp.concatenate([jaxrod.natural_frequencies(system), jaxrod.continuum.natural_frequencies(system, 3)])


@pytest.mark.parametrize("taper", [0.3, 1.0, 1.5])
@pytest.mark.parametrize("kind", MOTIONS)
def test_frequencies(kind, taper):
    """Of the rung and of the exact rod, as relative changes: reverse, forward, differences, and what dimensions say."""
    fn = jax.jit(functools.partial(_frequencies, kind))
    numbers = np.array([1e7, 1200.0, 0.03 * taper, 0.03, 1.3])
    f = np.asarray(fn(numbers))[:, None]
    reverse, forward = (np.asarray(jac(fn)(numbers)) * numbers / f for jac in (jax.jacrev, jax.jacfwd))
    step = 1e-3
    up, down, up2, down2 = (
        np.stack([fn(numbers * (1 + k * step * row)) for row in np.eye(5)], axis=1) for k in (1, -1, 2, -2)
    )
    differences = (8 * (up - down) - (up2 - down2)) / (12 * step) / f
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=1e-12)
    np.testing.assert_allclose(reverse, differences, rtol=0, atol=1e-8)
    np.testing.assert_allclose(reverse[:, [0, 1, 4]], np.tile([0.5, -0.5, -1.0], (4, 1)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(reverse[:, 2] + reverse[:, 3], 0.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("beta", [0.1, 1.0, 3.0])
def test_wave_numbers_of_the_exact_cone(beta):
    """d kappa / d beta from the frequency equations themselves, differentiated by hand; beta = r / R."""
    kappa, slope = jaxrod.continuum.held_free(beta, 1.0, 4), jax.jacrev(jaxrod.continuum.held_free)(beta, 1.0, 4)
    np.testing.assert_allclose(kappa / np.tan(kappa), 1 - beta, rtol=0, atol=1e-12)
    np.testing.assert_allclose(slope, 1 / (kappa / np.sin(kappa) ** 2 - 1 / np.tan(kappa)), rtol=1e-12)

    kappa, slope = jaxrod.continuum.free_free(beta, 1.0, 4), jax.jacrev(jaxrod.continuum.free_free)(beta, 1.0, 4)
    d, dd = (1 - beta) ** 2 / beta, 1 - 1 / beta**2
    sin, cos = np.sin(kappa), np.cos(kappa)
    np.testing.assert_allclose((kappa**2 + d) * sin, kappa * d * cos, rtol=0, atol=1e-11)
    by_d = (kappa * cos - sin) / (2 * kappa * sin + kappa**2 * cos + kappa * d * sin)
    np.testing.assert_allclose(slope, by_d * dd, rtol=1e-11, atol=1e-14)


# ---- Lagrangians of one's own


class _Oscillator(eqx.Module):
    stiffness: jax.Array

    def __call__(self, t, q, v):
        return v @ v / 2 - self.stiffness * (q @ q) / 2


@pytest.mark.slow
@pytest.mark.parametrize("made", ["closure", "module"])
def test_user_lagrangians(made):
    """q = q0 cos(sqrt(k) t), by a function that closes over k and by a module that holds it."""

    def end(k, q0, adjoint):
        function = _Oscillator(k) if made == "module" else lambda t, q, v: v @ v / 2 - k * (q @ q) / 2
        start = jnp.stack([q0]), jnp.zeros(1)
        return jaxrod.simulate(jaxrod.Lagrangian(function), start, t1=2.0, adjoint=adjoint).states.q[-1, 0]

    k, q0 = jnp.array(9.0), jnp.array(0.7)
    exact = [-q0 * 2.0 / (2 * np.sqrt(k)) * np.sin(2 * np.sqrt(k)), np.cos(2 * np.sqrt(k))]
    reverse = jax.jit(jax.grad(functools.partial(end, adjoint=None), argnums=(0, 1)))(k, q0)
    forward = jax.jit(jax.jacfwd(functools.partial(end, adjoint=diffrax.ForwardMode()), argnums=(0, 1)))(k, q0)
    np.testing.assert_allclose(reverse, exact, rtol=1e-9)
    np.testing.assert_allclose(forward, exact, rtol=1e-9)
