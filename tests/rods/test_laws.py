"""Strain laws: what every law must be, the stresses by hand, and a steady spin with its small vibrations.

With uniform strain e and stretch x = 1 + e, a spin W rests where I x W^2 = C W'(e).  About it the strain vibrates at
omega^2 = C W''(e) / I - W^2 where the spin is prescribed, and at 4 W^2 more where the angular momentum is kept instead.
With k = C / I and u = W^2 / k:

    Hooke        W'' = 1                   x = 1 / (1 - u)        k -   W^2   and  k + 3 W^2
    Green        e + e^2 / 2 = u           W'' = 1 + 3 u          k + 2 W^2   and  k + 6 W^2
    neo-Hookean  x^-3 = 1 - 3 u            W'' = 1 - 2 u          k - 3 W^2   and  k +   W^2
    logarithmic  ln x = u x^2              W'' = 1 / x^2 - u      k / x^2 - 2 W^2   and  k / x^2 + 2 W^2
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

import jaxrod

LAWS = (jaxrod.law.hooke, jaxrod.law.green, jaxrod.law.neo_hookean, jaxrod.law.logarithmic)
laws = pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)


def derivative(law, order, strain):
    """W, W' or W'' at many strains."""
    for _ in range(order):
        law = jax.grad(law)
    return np.asarray(jax.vmap(law)(jnp.asarray(strain)))


# ---- the functions


@laws
def test_all_laws_agree_at_small_strain(law):
    """W(0) = W'(0) = 0 and W''(0) = 1; so W = e^2 / 2 (1 + c e + ..), without cancellation however small e is."""
    np.testing.assert_array_equal([derivative(law, order, [0.0])[0] for order in range(3)], [0.0, 0.0, 1.0])
    small = np.array([-1e-4, 1e-4, -1e-8, 1e-8, -1e-100, 1e-100])
    np.testing.assert_allclose(derivative(law, 0, small) / (small**2 / 2), 1.0, rtol=0, atol=2 * 1e-4)
    np.testing.assert_allclose(derivative(law, 0, small)[2:] / (small[2:] ** 2 / 2), 1.0, rtol=0, atol=2 * 1e-8)
    np.testing.assert_allclose(derivative(law, 1, small) / small, 1.0, rtol=0, atol=2 * 1e-4)


STRETCH = np.array([0.6, 0.9, 1.0, 1.1, 1.7, 3.0])


@pytest.mark.parametrize(
    "law, energy, stress, stiffness",
    [
        (LAWS[0], lambda x: (x - 1) ** 2 / 2, lambda x: x - 1, lambda x: 1 + 0 * x),
        (LAWS[1], lambda x: (x**2 - 1) ** 2 / 8, lambda x: x * (x**2 - 1) / 2, lambda x: (3 * x**2 - 1) / 2),
        (LAWS[2], lambda x: (x**2 + 2 / x - 3) / 6, lambda x: (x - x**-2) / 3, lambda x: (1 + 2 * x**-3) / 3),
        (LAWS[3], lambda x: np.log(x) ** 2 / 2, lambda x: np.log(x) / x, lambda x: (1 - np.log(x)) / x**2),
    ],
    ids=[law.__name__ for law in LAWS],
)
def test_energy_and_stress_by_hand(law, energy, stress, stiffness):
    for order, by_hand in enumerate((energy, stress, stiffness)):
        got = derivative(law, order, STRETCH - 1)
        np.testing.assert_allclose(got, by_hand(STRETCH), rtol=1e-13, atol=1e-15, err_msg=f"W and {order} primes")


def test_where_the_docstrings_say_that_a_law_softens():
    """Green has no stiffness at x^2 = 1 / 3, the logarithmic law its greatest stress 1 / e at x = e."""
    assert derivative(LAWS[1], 2, [-0.42265])[0] == pytest.approx(0.0, abs=1e-5)
    assert derivative(LAWS[3], 2, [np.e - 1])[0] == pytest.approx(0.0, abs=1e-15)
    assert derivative(LAWS[3], 1, [np.e - 1])[0] == pytest.approx(1 / np.e, rel=1e-15)
    assert round(np.e - 1, 2) == 1.72


# ---- a steady spin and its vibrations


class Blend(eqx.Module):
    """All laws in one program: the weights of one of them."""

    weights: jax.Array

    def __call__(self, strain):
        return self.weights @ jnp.stack([law(strain) for law in LAWS])


RATES = np.array([0.1, 0.25, 0.4])  # W over (C / I)^1/2; the logarithmic law holds up to (1 / 2 e)^1/2 = 0.43


def spun(rod, rate, driven):
    motion = jaxrod.Driven(lambda t: rate * t) if driven else jaxrod.Rotation()
    system = jaxrod.System(rod, motion)
    state = jaxrod.equilibrium(system) if driven else jaxrod.equilibrium(system, spin=rate)
    return state.strain, jnp.max(jaxrod.modes(system, state).frequency)


@pytest.mark.parametrize("driven", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["prescribed", "free"])
def test_vibrations_about_a_steady_spin(driven, cone):
    """Strain and frequency, to 1e-8, of the four laws at three rates."""
    k = float(cone.stiffness / cone.moment_of_inertia())
    rates = np.sqrt(k) * RATES

    def vibration(weights, rate):
        rod = jaxrod.Rod(1.0, cone.section, cone.young, cone.density, law=Blend(weights))
        return spun(rod, rate, driven)

    weights, each = np.repeat(np.eye(4), 3, axis=0), np.tile(rates, 4)
    found = jax.jit(jax.vmap(vibration))(weights, each)
    strain, frequency = (np.asarray(x).reshape(4, 3) for x in found)
    square, u = rates**2, RATES**2
    logarithmic = -scipy.special.lambertw(-2 * u).real / (2 * u)  # x^2
    stretch = np.stack([1 / (1 - u), np.sqrt(1 + 2 * u), (1 - 3 * u) ** (-1 / 3), np.sqrt(logarithmic)])
    np.testing.assert_allclose(1 + strain, stretch, rtol=1e-10)
    prescribed = np.stack([k - square, k + 2 * square, k - 3 * square, k / logarithmic - 2 * square])
    omega = np.sqrt(prescribed + (0 if driven else 4) * square)
    np.testing.assert_allclose(2 * np.pi * frequency, omega, rtol=1e-8)
    assert np.all(np.ptp(omega, axis=0) > 1e-2 * omega[0]), "the laws must differ"


# ---- a law of one's own


class Stiffening(eqx.Module):
    """Three lines."""

    more: jax.Array

    def __call__(self, strain):
        return strain**2 / 2 + self.more * strain**4


def test_gradient_by_a_number_of_a_law(cone):
    """u (1 + e) = e + 4 m e^3, so de/dm = -4 e^3 / (1 + 12 m e^2 - u); and by central differences."""
    k, u = float(cone.stiffness / cone.moment_of_inertia()), 0.3

    def strain(more):
        rod = jaxrod.Rod(1.0, cone.section, cone.young, cone.density, law=Stiffening(more))
        return jaxrod.equilibrium(jaxrod.System(rod, jaxrod.Driven(lambda t: np.sqrt(u * k) * t))).strain

    more, step = 2.0, 1e-4
    found = jax.jit(jax.vmap(jax.value_and_grad(strain)))(jnp.array([more, more - step, more + step]))
    e, by_more = (np.asarray(x) for x in found)
    assert abs(u * (1 + e[0]) - e[0] - 4 * more * e[0] ** 3) < 1e-12
    assert by_more[0] == pytest.approx((e[2] - e[1]) / (2 * step), rel=1e-7)
    assert by_more[0] == pytest.approx(-4 * e[0] ** 3 / (1 + 12 * more * e[0] ** 2 - u), rel=1e-10)


def twin(rod, law):
    return jaxrod.Rod(rod.length, rod.section, rod.young, rod.density, rod.tip_mass, rod.tip_inertia, law)


@pytest.mark.parametrize("basis", [jaxrod.Ritz(3), jaxrod.ForceRitz(3)], ids=["Ritz", "ForceRitz"])
def test_energy_of_a_uniform_strain(basis, uniform):
    """E A L W(e), whatever the number of shapes; and half the rod stretched twice as far is not the same."""
    volume = float(uniform.young * uniform.length) * np.pi * 0.025**2
    e = np.array([-0.3, 0.2, 1.0])

    def energies(strain):
        systems = [jaxrod.System(twin(uniform, law), jaxrod.Rotation(), basis) for law in LAWS]
        return jnp.stack([system.elastic_energy(system.state(strain=strain)) for system in systems])

    got = np.asarray(jax.jit(jax.vmap(energies))(e)).T
    want = volume * np.stack([derivative(law, 0, e) for law in LAWS])
    np.testing.assert_allclose(got, want, rtol=1e-13)


def test_hooke_as_a_matrix_is_hooke_as_a_law(cone):
    """Hooke's law, which goes by K, and a user's copy of it, which is summed along the rod: one acceleration."""
    heavy = jaxrod.Rod(1.0, cone.section, cone.young, cone.density, tip_mass=0.3, tip_inertia=0.01)
    copies = [heavy, twin(heavy, lambda strain: 0.5 * strain**2)]
    assert [rod.linear for rod in copies] == [True, False]

    def acceleration(q, v):
        systems = [jaxrod.System(rod, jaxrod.Rotation(0.3), jaxrod.Ritz(4), gravity=9.81) for rod in copies]
        return jnp.stack([system.equations(jaxrod.Angles()).acceleration(0.0, q, v) for system in systems])

    rng = np.random.default_rng(1)
    q, v = rng.uniform(-0.1, 0.1, (50, 5)), rng.normal(0, 10, (50, 5))
    matrix, law = np.moveaxis(np.asarray(jax.jit(jax.vmap(acceleration))(q, v)), 1, 0)
    np.testing.assert_allclose(law, matrix, rtol=0, atol=1e-12 * np.max(np.abs(matrix)))


def test_green_holds_at_any_spin():
    """e + e^2 / 2 = W^2 I / C has a root at every rate, beyond Hooke's critical one too."""
    rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.025), 1e7, 1200.0, law=jaxrod.law.green)
    system = jaxrod.System(rod, jaxrod.Rotation())
    ratio = float(rod.moment_of_inertia() / rod.stiffness)
    for rate in (50.0, 157.0, 200.0):
        strain = np.sqrt(1 + 2 * rate**2 * ratio) - 1
        np.testing.assert_allclose(jaxrod.equilibrium(system, spin=rate).strain, strain, rtol=1e-12)
