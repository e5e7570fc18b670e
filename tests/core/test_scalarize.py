"""Number by number is the same arithmetic: whatever function, and all its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.core.scalarize import Numbers, by_number, gathered, scattered
from jaxrod.core.tracing import depends_on_first

A, B = jnp.array([[2.0, 0.5], [0.5, 1.0]]), jnp.array([0.3, -0.7])

FUNCTIONS = {
    "form": lambda x: x @ A @ x / 2 - B @ x,
    "division": lambda x: 1 / (1 + x @ x) + x[0] / jnp.sqrt(x @ x),
    "moves": lambda x: jnp.concatenate([x[::-1], jnp.stack([x[0], x[1]])]).reshape(2, 2).T @ B,
    "products": lambda x: jnp.outer(x, B).sum(0) * 2.0 * 0.5 - (x - x) + 0.0 * x,
    "elementary": lambda x: jnp.sin(x[0]) * jnp.exp(-x[1]) + jnp.where(x[0] > 0, x[0] ** 3, x[1] ** -2),
    "other": lambda x: jnp.sort(x) + jnp.cumsum(x),  # no number by number for these: on arrays, as written
    "padded": lambda x: jnp.pad(x, (1, 2))[1:4] + jnp.linalg.norm(x),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_and_derivatives(name):
    function, x = FUNCTIONS[name], jnp.array([0.4, -1.3])
    for f in (function, jax.jacfwd(function), jax.jacrev(function)):
        np.testing.assert_allclose(gathered(by_number(f)(scattered(x))), f(x), rtol=1e-14, atol=1e-15)

    def outside(x):
        return gathered(by_number(function)(scattered(x)))

    np.testing.assert_allclose(jax.jacrev(outside)(x), jax.jacrev(function)(x), rtol=1e-14, atol=1e-15)
    lanes = jnp.stack([x, 2 * x, -x])
    np.testing.assert_allclose(jax.vmap(outside)(lanes), jax.vmap(function)(lanes), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("n", [1, 3])
def test_accelerations(cone, n):
    """A whole equation of motion, with forces, from numbers."""
    system = jaxrod.System(cone, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81, forces=[jaxrod.KelvinVoigt(0.01)])
    equations = system.equations(jaxrod.Angles())
    q, v = equations.encode(0.0, system.state(angle=0.3, rate=15.0, strain=0.01, strain_rate=0.2))

    def acceleration(equations, q, v):
        return equations.acceleration(0.0, q, v)

    found = gathered(by_number(acceleration)(*scattered((equations, q, v))))
    np.testing.assert_allclose(found, acceleration(equations, q, v), rtol=1e-12)


def test_one_division_serves_all():
    """Quotients by one number share its inverse; zeros by structure are not computed."""

    def function(x):
        return x / (x @ x) + B / (x @ x) + 0.0 * jnp.exp(x)

    program = str(jax.make_jaxpr(lambda x: by_number(function)(scattered(x)).values)(B))
    assert program.count(" div ") == 1
    assert "dot_general" not in program


def test_numbers_are_a_pytree():
    numbers = scattered(jnp.arange(6.0).reshape(2, 3))
    assert isinstance(numbers, Numbers) and len(jax.tree.leaves(numbers)) == 6
    np.testing.assert_array_equal(gathered(numbers[1]), [3.0, 4.0, 5.0])
    assert numbers[1, 2] == 5.0


def test_dependence():
    assert depends_on_first(lambda x, y: y * x, 1.0, 2.0)
    assert not depends_on_first(lambda x, y: y * 2, 1.0, 2.0)
    assert not depends_on_first(lambda x, y: (jnp.sin(x), y)[1], 1.0, 2.0)
