"""Functions along the rod: what a quadrature cannot see at once is found, refined, or said."""

import dataclasses
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import make_rod, scene

import jaxrod
from jaxrod import continuum
from jaxrod.rods.resolution import Resolution


def steel(section, **numbers):
    return make_rod(section=section, **({"young": 2e11, "density": 7800.0} | numbers))


def held(body, basis=None, pivot=None):
    return scene(jaxrod.Rotation(pivot), basis, rod=body)


def exact(section, n=1, pivot=None, **numbers):
    return continuum.natural_frequencies(held(steel(section, **numbers), pivot=pivot), n)


def step(b, thick=4e-4):
    return lambda s: jnp.where(s < b, thick, 1e-4)


def neck(width, at=0.4):
    return lambda s: 1e-4 * (1 - 0.9 * jnp.exp(-(((s - at) / width) ** 2)))


def ribs(s):
    return 1e-4 * (1 + 0.6 * jnp.sin(40 * jnp.pi * s))


def collar(s):
    return 7800.0 * (1 + 30 * jnp.exp(-(((s - 0.803) / 0.002) ** 2)))


class Stepped(eqx.Module):
    """A step whose place is a leaf."""

    at: jax.Array

    def __call__(self, s):
        return jnp.where(s < self.at, 4e-4, 1e-4)


class Necked(eqx.Module):
    """A neck whose place is a leaf."""

    at: jax.Array

    def __call__(self, s):
        return neck(0.01, self.at)(s)


def close(got, want, rtol=1e-9):
    np.testing.assert_allclose(np.asarray(got), want, rtol=rtol, atol=0)


# ---- known functions.  Frequencies: SciPy's DOP853 along the rod at 1e-12, and a root of the tension at the tip


CASES = {
    "neck": (neck(0.01), {}, [1216.6037046, 3827.8155190, 5926.8145655]),
    "neck, with breaks": (
        jaxrod.Profile(neck(0.01), breaks=[0.35, 0.37, 0.38, 0.39, 0.4, 0.41, 0.42, 0.43, 0.45]),
        {},
        [1216.6037046, 3827.8155190, 5926.8145655],
    ),
    "ribs": (ribs, {}, [1143.5296864, 3429.0526034, 5709.9057956]),
    "collar": (lambda s: 1e-4 + 0 * s, {"density": collar}, [1157.5589975, 3676.2657561, 6329.1715900]),
}


@pytest.mark.parametrize("name", CASES)
def test_narrow_features_are_resolved(name):
    section, numbers, want = CASES[name]
    body = steel(section, **numbers)
    close(continuum.natural_frequencies(held(body), 3), want)
    close(continuum.natural_frequencies(held(body), 1), want[:1])
    close(jaxrod.natural_frequencies(held(body, jaxrod.LoadRitz(8)))[:2], want[:2], 1e-7)


def test_a_step_without_breaks():
    """tan(0.43 x) tan(0.57 x) = 4, x = 2 pi f L / c."""
    body = steel(step(0.43))
    close(body.mass, 7800 * (0.43 * 4e-4 + 0.57 * 1e-4), 1e-14)
    close(body.moment_of_inertia(), 7800 * (4e-4 * 0.43**3 + 1e-4 * (1 - 0.43**3)) / 3, 1e-14)
    close(body.breaks, 0.43, 1e-15)
    first = 1756.943862668
    close(continuum.natural_frequencies(held(body), 1), first)
    close(jaxrod.natural_frequencies(held(body, jaxrod.LoadRitz(6)))[0], first)
    close(jaxrod.natural_frequencies(held(body, jaxrod.Ritz(8)))[0], first, 1e-6)


def test_the_first_frequency_does_not_depend_on_how_many():
    firsts = [exact(lambda s: 1e-4 + 0 * s, n, density=collar)[0] for n in (1, 12, 24)]
    close(firsts, 1157.558997525)


def test_kinks_and_other_edges():
    """Where straight pieces meet, exactly; a narrow slot; a root of the distance from the tip."""
    x, area = np.linspace(0.0, 1.0, 21), 1e-4 * (1 + 0.3 * np.cos(np.arange(21.0)))
    close(steel(lambda s: jnp.interp(s, x, area)).mass, 7800 * np.trapezoid(area, x), 1e-13)
    close(steel(lambda s: 1e-4 * jnp.maximum(1.0, 2 - 3 * s)).volume, 1e-4 * (1 + 1 / 6), 1e-13)
    slot = steel(lambda s: 1e-4 * jnp.where(jnp.abs(s - 0.3) < 4e-4, 0.1, 1.0))
    close(slot.volume, 1e-4 * (1 - 0.9 * 8e-4), 1e-12)
    close(steel(lambda s: 1e-4 * jnp.sqrt(1 - s)).volume, 1e-4 * 2 / 3, 1e-10)
    pointed = steel(lambda s: 1e-3 * (1 - s) ** 2, young=1e7, density=1200.0)
    close(continuum.natural_frequencies(held(pointed), 1), np.sqrt(1e7 / 1200) / 2, 1e-9)


def test_what_cannot_be_resolved_is_said():
    with pytest.warns(UserWarning, match=r"near s=0\.\d+ m: .* breaks="):
        steel(lambda s: 1e-4 * (1 + jnp.floor(s * 300) % 2))
    with pytest.warns(UserWarning, match="breaks="):
        steel(lambda s: 1e-4 * (1 + 0.5 * jnp.sin(1e5 * s)))
    with pytest.raises(ValueError, match=r"section has area .* at s=0\.69"):
        steel(lambda s: 1e-4 * (1 - 1.2 * jnp.exp(-(((s - 0.7) / 2e-3) ** 2))))


def test_others_are_not_looked_at(monkeypatch):
    def never(*_):
        raise AssertionError

    monkeypatch.setattr("jaxrod.rods.looking.resolve", never)
    table = jaxrod.Table([0.0, 0.4, 1.0], radii=[0.02, 0.03, 0.01])
    for section in (
        jaxrod.Uniform(0.02),
        jaxrod.Cone(0.02, 0.03),
        table,
        jaxrod.PiecewiseConstant([0.4], [2e-3, 1e-3]),
    ):
        body = steel(section, young=jaxrod.PiecewiseConstant([0.7], [2e11, 7e10]))
        assert body.resolution == Resolution()
        assert bool(body.valid())


# ---- under transformations


def test_known_functions_stay_resolved_where_other_numbers_are_traced():
    body, want = steel(neck(0.01)), 1216.6037046

    def first(body):
        return continuum.natural_frequencies(held(body), 1)[0]

    close(jax.jit(lambda young: exact(neck(0.01), young=young)[0])(2e11), want)
    close(jax.jit(lambda young: first(dataclasses.replace(body, young=young)))(2e11), want)
    close(jax.jit(lambda young: first(eqx.tree_at(lambda x: x.young, body, young)))(2e11), want)
    close(eqx.filter_jit(first)(body), want)
    close(jaxrod.sweep(lambda young: exact(neck(0.01), young=young)[0], jnp.array([2e11, 8e11])), [want, 2 * want])


@pytest.mark.parametrize("jacobian", [pytest.param(jax.jacfwd, marks=pytest.mark.slow), jax.jacrev])
def test_derivatives_are_of_the_resolved_rod(jacobian):
    """By the width, the place and the length: central differences of the values."""

    def function(x):
        return exact(neck(x[0], x[1]), length=x[2])[0]

    x = jnp.array([0.01, 0.4, 1.0])
    difference = [(function(x + d) - function(x - d)) / 2e-6 for d in 1e-6 * jnp.eye(3)]
    close(jacobian(function)(x), difference, 1e-6)


@pytest.mark.slow
def test_traced_functions_that_fixed_panels_do_not_resolve():
    """A gentle function is right; of a narrow one frequencies are NaN, `sweep` counts them and a run ends `invalid`."""
    widths = jnp.array([0.01, 0.02, 0.2])
    with pytest.warns(UserWarning, match="2 gave answers that are not finite"):
        got = jaxrod.sweep(lambda width: exact(neck(width))[0], widths)
    assert np.isnan(got[:2]).all()
    close(got[2], exact(neck(0.2))[0])

    @jax.jit
    def run(width):
        system = held(steel(neck(width), young=2e9), jaxrod.LoadRitz(2))
        sol = jaxrod.simulate(system, system.state(rate=5.0), t1=0.01)
        return sol.result, jaxrod.natural_frequencies(system), system.rod.mass, system.rod.valid()

    result, *numbers, valid = run(0.01)
    assert "make no sense" in jaxrod.Result[result]
    assert all(np.isnan(x).all() for x in numbers)
    assert not valid
    assert run(0.3)[-1]


def test_a_rod_changed_after_it_was_looked_at():
    body = steel(Necked(jnp.asarray(0.4)))
    moved = eqx.tree_at(lambda x: x.section.function.at, body, jnp.asarray(0.7))
    assert bool(body.valid())
    assert not bool(moved.valid())
    assert np.isnan(moved.moment_of_inertia())
    assert np.isnan(continuum.natural_frequencies(held(moved), 1)).all()
    rods = eqx.filter_vmap(lambda at: steel(Necked(at)))(jnp.array([0.4, 0.7]))
    assert np.isnan(eqx.filter_vmap(lambda x: x.mass)(rods)).all()


# ---- by the place of a jump


@pytest.mark.parametrize("make", [step, Stepped])
@pytest.mark.parametrize("jacobian", [jax.grad, jax.jacfwd, jax.jacrev])
def test_the_place_of_a_jump_is_refused(make, jacobian):
    with pytest.raises(ValueError, match=r"jumps at s=0\.43 m.*PiecewiseConstant.*breaks="):
        jacobian(lambda b: exact(make(b))[0])(0.43)


def test_the_place_of_a_jump_is_not_a_number_under_jit():
    gradient = jax.jit(jax.grad(lambda b: exact(step(b))[0]))
    assert np.isnan(gradient(0.43))
    given = jax.grad(lambda b: exact(jaxrod.Profile(step(b), [0.43]))[0])
    assert np.isnan(given(0.43))
    assert np.isnan(jax.jit(given)(0.43))
    body = steel(Stepped(jnp.asarray(0.43)))
    assert np.isnan(eqx.filter_grad(lambda x: x.mass)(body).section.function.at)
    close(eqx.filter_grad(lambda x: x.mass)(body).density, float(body.mass) / 7800)


@pytest.mark.slow
def test_derivatives_by_what_is_no_place_of_a_jump():
    """The area of a step; the place of a kink, in all spellings."""

    def slope(make, x, h):
        function = lambda x: exact(make(x))[0]  # noqa: E731
        close(jax.grad(function)(x), (function(x + h) - function(x - h)) / (2 * h), 1e-6)

    slope(lambda thick: step(0.43, thick), 4e-4, 1e-8)
    slope(lambda k: lambda s: 1e-4 * jnp.maximum(1.0, 2 - k * s), 3.0, 1e-4)
    slope(lambda b: lambda s: 1e-4 * jnp.where(s < b, 2.0, 2 - (s - b)), 0.3, 1e-4)
    slope(lambda b: lambda s: jnp.interp(s, jnp.stack([0.0, b, 1.0]), 1e-4 * jnp.array([1.0, 3.0, 2.0])), 0.3, 1e-4)


# ---- supports on knots and breaks


def table():
    section = jaxrod.Table([0.0, 0.3, 0.55, 1.0], radii=[0.02, 0.03, 0.02, 0.01])
    return make_rod(section=section, tip_mass=0.4)


BASES = [
    (jaxrod.Ritz(2), [2.5224, -312.642]),
    (jaxrod.ForceRitz(2), [6.6625, -340.603]),
    (jaxrod.LoadRitz(2), [6.5951, -300.891]),
]


@pytest.mark.parametrize(("basis", "want"), BASES, ids=lambda x: repr(x))
def test_by_a_pivot_on_a_knot(basis, want):
    function = lambda p: jaxrod.natural_frequencies(held(table(), basis, p))  # noqa: E731
    close(jax.jacfwd(function)(0.3), want, 1e-4)
    close(jax.jacrev(function)(0.3), want, 1e-4)


@pytest.mark.parametrize("width, right", [(1e-4, True), (2e-5, True), (1e-6, False), (1e-7, False)])
def test_by_the_place_of_a_steep_step(width, right):
    """Right, or refused: a slope that the panels do not resolve is a derivative that is not right."""

    def first(place):
        area = lambda s: 1e-4 + 3e-4 * jax.nn.sigmoid((place - s) / width)  # noqa: E731
        return exact(area)[0]

    if right:
        close(jax.grad(first)(0.43), 749.479, 1e-3)
    else:
        with pytest.raises(ValueError, match=r"so steep between s=\S+ and \S+ m"):
            jax.grad(first)(0.43)


def test_by_a_pivot_on_a_kink_that_was_looked_for():
    """It is known to 1e-12 of the length alone, and no panel is left between the two."""
    kinked = make_rod(section=lambda s: 1e-3 * (1 + jnp.abs(s - 0.4)))
    named = make_rod(section=jaxrod.Profile(lambda s: 1e-3 * (1 + jnp.abs(s - 0.4)), [0.4]))
    for rod in (kinked, named):
        close(
            jax.jacfwd(lambda p, rod=rod: jaxrod.natural_frequencies(held(rod, jaxrod.LoadRitz(2), p)))(0.4),
            [64.7891, -144.2724],
            1e-5,
        )
        close(
            jax.jacfwd(lambda p, rod=rod: jaxrod.continuum.natural_frequencies(held(rod, jaxrod.Ritz(1), p), 2))(0.4),
            [64.7346, -144.1636],
            1e-5,
        )


@pytest.mark.slow
def test_by_a_pivot_on_a_break():
    """Frequencies have a kink where rigidity jumps, and none where only a name is given to a place."""
    stepped = make_rod(young=jaxrod.PiecewiseConstant([0.3], [1e7, 2e7]))
    named = make_rod(section=jaxrod.Profile(lambda s: 1e-3 * jnp.exp(s), [0.3, 0.6]))
    bases = {"uniform": jaxrod.Ritz(1), "pieces": jaxrod.Ritz(2), "loads": jaxrod.LoadRitz(2)}

    def slope(body, basis):
        function = lambda p: jaxrod.natural_frequencies(held(body, basis, p))[0]  # noqa: E731
        return jax.jacfwd(function)(0.3), (function(0.3 + 1e-5) - function(0.3 - 1e-5)) / 2e-5

    close(*slope(stepped, bases["uniform"]), 1e-4)
    assert np.isnan(slope(stepped, bases["loads"])[0])
    close(*slope(named, bases["loads"]), 1e-6)
    assert np.isnan(slope(named, bases["pieces"])[0])
    assert np.isnan(jax.jacfwd(lambda p: continuum.natural_frequencies(held(stepped, pivot=p), 1))(0.3)).all()
    smooth = jax.jacfwd(lambda p: continuum.natural_frequencies(held(named, pivot=p), 1))(0.3)
    close(smooth, 46.3414, 1e-5)


def test_by_the_length_where_the_table_ends_and_by_its_positions():
    def by_length(length):
        return exact(jaxrod.Table([0.0, 0.4, 1.0], radii=[0.02, 0.03, 0.01]), 2, length=length)

    close(jax.jacfwd(by_length)(1.0), (by_length(1.0) - by_length(1 - 1e-6)) / 1e-6, 1e-5)
    assert np.isnan(jax.jit(by_length)(1.01)).all()

    def by_position(p):
        return exact(jaxrod.Table([0.0, p, 1.0], radii=[0.02, 0.03, 0.01]), 2)

    close(jax.jacfwd(by_position)(0.4), (by_position(0.4 + 1e-6) - by_position(0.4 - 1e-6)) / 2e-6, 1e-6)


# ---- a force where there is nothing to bear it, a warning about a profile


@pytest.mark.parametrize("basis", [jaxrod.ForceRitz(1), jaxrod.ForceRitz(3), jaxrod.QuasiStatic(jaxrod.ForceRitz(2))])
def test_a_constant_force_and_a_point(basis):
    with pytest.raises(ValueError, match="comes to a point"):
        held(steel(jaxrod.Cone(0.026, 0.0)), basis)
    with pytest.raises(ValueError, match="comes to a point"):
        held(steel(lambda s: 1e-3 * (1 - s) ** 2), basis)


def test_a_constant_force_and_a_traced_point():
    tips = jnp.array([0.0, 1e-3])
    got = jax.vmap(lambda tip: jaxrod.natural_frequencies(held(steel(jaxrod.Cone(0.026, tip)), jaxrod.ForceRitz(2))))(
        tips
    )
    assert np.isnan(got[0]).all()
    assert np.isfinite(got[1]).all()


def test_too_fast_a_composite_is_warned_of():
    fast = jaxrod.PiecewiseConstant([0.5], [1e12, 2e12])
    with pytest.warns(UserWarning, match="beyond any solid"):
        steel(jaxrod.Uniform(0.01), young=fast, density=jaxrod.PiecewiseConstant([0.5], [1e3, 1e3]))


def test_smooth_functions_need_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = steel(lambda s: 1e-3 * jnp.exp(-s)).resolution
    assert dataclasses.replace(found, place=0.0) == Resolution()
