"""In every lane the same arithmetic: whatever function, all its derivatives, and scenes that become lanes under vmap."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.core.each_lane import lanewise
from jaxrod.core.lanes import alone, lanes_of, over_lanes, spread, widened
from jaxrod.core.tracing import depends_on_first

A, B = jnp.array([[2.0, 0.5], [0.5, 1.0]]), jnp.array([0.3, -0.7])
LANES = jnp.array([[0.4, 0.8, -0.4], [-1.3, -2.6, 1.3]])

FUNCTIONS = {
    "form": lambda x: x @ A @ x / 2 - B @ x,
    "division": lambda x: 1 / (1 + x @ x) + x[0] / jnp.sqrt(x @ x),
    "moves": lambda x: jnp.concatenate([x[::-1], jnp.stack([x[0], x[1]])]).reshape(2, 2).T @ B,
    "matrices": lambda x: jnp.einsum("ij,jk,k->i", jnp.outer(x, B), A, x) + (A * x[None, :]) @ (A + x[:, None])[0],
    "batches": lambda x: jnp.einsum("bij,bj->bi", jnp.stack([A, 2 * A]) * x[:, None, None], jnp.stack([x, B])),
    "products": lambda x: jnp.outer(x, B).sum(0) * 2.0 * 0.5 - (x - x) + 0.0 * x,
    "elementary": lambda x: jnp.sin(x[0]) * jnp.exp(-x[1] / 4) + jnp.where(x[0] > 0, x[0] ** 3, x[1] ** -2),
    "other": lambda x: jnp.sort(x) + jnp.cumsum(x) + jnp.array([1.0, 2.0, 3.0])[jnp.argmax(x)],
    "padded": lambda x: jnp.pad(x, (1, 2))[1:4] + jnp.linalg.norm(x) + jnp.pad(x, (1, 0), constant_values=x[1]).sum(),
    "loops": lambda x: jax.lax.fori_loop(0, 3, lambda k, y: y * x + k, x),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_and_derivatives(name):
    function = FUNCTIONS[name]
    forward = [function, jax.jacfwd(function)]
    for f in forward if name == "loops" else [*forward, jax.jacrev(function)]:
        expected = jax.vmap(f, in_axes=1, out_axes=-1)(LANES)
        found = widened(lanewise(f)(LANES), 3)
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(lanewise(f)(LANES[:, :1])[..., 0], expected[..., 0], rtol=1e-13, atol=1e-14)


@jax.custom_jvp
def _magnitude(x):
    return jnp.abs(x)


_magnitude.defjvp(lambda at, rates: (_magnitude(*at), 7.0 * rates[0]))


@jax.custom_vjp
def _damped(x):
    return jnp.abs(x)


_damped.defvjp(lambda x: (_damped(x), None), lambda _, bar: (5.0 * bar,))


@pytest.mark.parametrize(("function", "slope"), [(_magnitude, 7.0), (_damped, 5.0)])
def test_rules_of_derivatives_are_kept(function, slope):
    """As where the derivative of a force is known better than by its operations."""
    many = lanewise(lambda x: 2 * function(x))
    np.testing.assert_allclose(many(LANES), 2 * jnp.abs(LANES))
    np.testing.assert_allclose(jax.grad(lambda x: many(x).sum())(LANES), jnp.full_like(LANES, 2 * slope))
    alike = jax.grad(lambda x: many(x).sum())(LANES[:, :1])
    np.testing.assert_allclose(alike, jnp.full_like(alike, 2 * slope))


def test_no_matrix_product_is_left():
    """A call of one would end the one compiled loop."""
    program = str(jax.make_jaxpr(lanewise(FUNCTIONS["matrices"]))(LANES))
    assert "dot_general" not in program


def test_what_is_alike_stays_so():
    """Numbers common to all lanes are computed once."""
    common, own = lanewise(lambda x, y: (jnp.exp(x), x * y))(B[:, None], LANES)
    assert common.shape == (2, 1) and own.shape == (2, 3)


@pytest.mark.parametrize("n", [1, 3])
def test_accelerations(cone, n):
    """A whole equation of motion, with forces."""
    system = jaxrod.System(cone, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81, forces=[jaxrod.KelvinVoigt(0.01)])
    equations = system.equations(jaxrod.Angles())
    q, v = equations.encode(0.0, system.state(angle=0.3, rate=15.0, strain=0.01, strain_rate=0.2))

    def acceleration(equations, q, v):
        return equations.acceleration(0.0, q, v)

    found = lanewise(acceleration)(*spread((equations, q)), jnp.stack([v, 2 * v], axis=-1))
    for k in range(2):
        np.testing.assert_allclose(found[:, k], acceleration(equations, q, (k + 1) * v), rtol=1e-11)


def _decay(y, rate, count):
    """`count` steps of y' = -rate sin y, in every lane its own count."""
    lanes = lanes_of((y, rate, count))

    def step(carry):
        k, y = carry
        return k + 1, jnp.where(k < count, y - 0.01 * rate * jnp.sin(y), y)

    return jax.lax.while_loop(lambda carry: carry[0] < jnp.max(count), step, (0, widened(y, lanes)))[1]


def _end(y, rate, count=5):
    return alone(over_lanes(_decay)(*spread((y, rate, count))))


def _plain(y, rate, count=5):
    for _ in range(count):
        y = y - 0.01 * rate * jnp.sin(y)
    return y


Y, RATE = jnp.arange(3.0), jnp.asarray(2.0)
MAPS = {
    "value": lambda f: f(Y, RATE),
    "by scene": lambda f: jax.vmap(f, (0, None))(jnp.stack([Y, Y + 1]), RATE),
    "by both": lambda f: jax.vmap(lambda r: jax.vmap(lambda y: f(y, r))(jnp.stack([Y, Y + 1])))(jnp.array([1.0, 2.0])),
    "along": lambda f: jax.jvp(lambda r: f(Y, r), (RATE,), (jnp.ones(()),)),
    "scenes along": lambda f: jax.vmap(lambda y: jax.jvp(lambda r: f(y, r), (RATE,), (RATE,)))(jnp.stack([Y, Y + 1])),
    "along scenes": lambda f: jax.jvp(lambda r: jax.vmap(lambda y: f(y, r))(jnp.stack([Y, Y + 1])), (RATE,), (RATE,)),
    "jacfwd": lambda f: jax.jacfwd(f)(Y, RATE),
    "twice": lambda f: jax.jit(jax.jacfwd(jax.jacfwd(f)))(Y, RATE),
    "scenes twice": lambda f: jax.vmap(jax.jacfwd(jax.jacfwd(f)), (0, None))(jnp.stack([Y, Y + 1]), RATE),
}


@pytest.mark.parametrize("name", MAPS)
def test_scenes_become_lanes(name):
    found, expected = MAPS[name](_end), MAPS[name](_plain)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-15)


def test_the_last_axis_is_the_lane():
    """Under vmap no loop has the scenes first."""
    program = str(jax.make_jaxpr(lambda y: jax.vmap(_end, (0, None))(y, RATE))(jnp.ones((64, 3))))
    assert (
        "f64[3,64]" in program.split("while")[1]
        and "f64[64,3]" not in program.split("while")[1].split("body_jaxpr")[1][:800]
    )


def test_each_lane_stops_by_itself():
    ends = jax.vmap(_end, (None, None, 0))(Y, RATE, jnp.array([0, 5, 2]))
    for end, count in zip(ends, (0, 5, 2), strict=True):
        np.testing.assert_allclose(end, _plain(Y, RATE, count), rtol=1e-14)


def test_dependence():
    assert depends_on_first(lambda x, y: y * x, 1.0, 2.0)
    assert not depends_on_first(lambda x, y: y * 2, 1.0, 2.0)
    assert not depends_on_first(lambda x, y: (jnp.sin(x), y)[1], 1.0, 2.0)
