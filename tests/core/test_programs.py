"""Programs for few runs are compiled sooner, and one for all functions that are alike."""

import io

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.core import tracing


@pytest.fixture
def compiled():
    """How many programs were compiled so far."""
    seen = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, seconds, **_: seen.append(name) if name.endswith("backend_compile_duration") else None
    )
    return lambda: len(seen)


def _wave(scale, x):
    return scale * jnp.sin(x) ** 2


def test_one_program_for_many_runs_and_one_for_few(compiled):
    program, x = tracing.program(_wave), jnp.arange(3.0)
    jax.block_until_ready(jnp.zeros(()))
    before = compiled()
    optimised = [program(2.0, x) for _ in range(2)]
    assert compiled() == before + 1
    few = [program(2.0, x, seldom=True) for _ in range(2)]
    assert compiled() == before + 2
    np.testing.assert_allclose(few, optimised, rtol=1e-15)


def test_where_operations_of_known_numbers_are_traced(compiled):
    x = np.arange(3.0)  # no tracer, though jit traces what is done with it
    run = tracing.run_seldom(_wave)
    np.testing.assert_allclose(jax.jit(lambda: run(2.0, x))(), _wave(2.0, x), rtol=1e-15)


@pytest.mark.parametrize("way", [jax.jit, jax.vmap, jax.grad, jax.jacfwd, lambda f: jax.jit(jax.vmap(f))], ids=str)
def test_under_transformations(way):
    def answer(run):
        given = jnp.asarray(0.7) if way in (jax.grad, jax.jacfwd) else jnp.array([0.7])
        return way(lambda x: run(2.0, x))(given)

    np.testing.assert_allclose(answer(tracing.run_seldom(_wave)), answer(_wave), rtol=1e-14)


def test_a_traced_number_in_a_closure():
    run = tracing.run_seldom(lambda function, x: function(x))
    slope = jax.grad(lambda k: run(lambda x: k * x**2, jnp.asarray(3.0)))(1.0)
    assert slope == 9.0


def _frequency(section, scene):
    return float(jaxrod.natural_frequencies(scene(section=section))[0])


def _tapered(slope):
    return lambda s: 1e-3 * (1 + slope * s)


def test_a_lambda_like_one_before_compiles_nothing(compiled, scene):
    first = _frequency(_tapered(0.5), scene)
    before = compiled()
    assert _frequency(_tapered(0.5), scene) == first
    assert compiled() == before
    assert _frequency(_tapered(0.6), scene) != first


def test_what_a_lambda_holds_tells_it_from_others():
    """Two of one code, whatever they read: a global, a default, an array, a function within."""
    within = lambda k: lambda s: k * s  # noqa: E731

    def made(k):
        inner = within(k)
        array, module = jnp.array([k, 1.0]), jaxrod.Cone(k, 1.0)
        return [
            lambda s: k * s,
            lambda s, k=k: k * s,
            lambda s: inner(s),
            lambda s: array @ s,
            lambda s: module.area(s, 1.0),
        ]

    for one, same, other in zip(made(1.0), made(1.0), made(2.0), strict=True):
        told = [tracing.carried(f).func for f in (one, same, other)]
        assert told[0] is told[1] is one and told[2] is other


_SLOPE = 1.0


def test_a_variable_that_changes(monkeypatch):
    """A function that was seen before no longer stands for what it then was."""

    def made():
        return lambda s: _SLOPE * s

    first = tracing.carried(made())
    assert tracing.carried(made()).func is first.func
    monkeypatch.setattr(__import__(__name__), "_SLOPE", 2.0)
    assert tracing.carried(made())(1.0) == 2.0
    found = []
    for k in (1.0, 2.0, 3.0):  # these three share the variable, which is 3 in the end
        found.append(tracing.carried(lambda s: k * s)(1.0))  # noqa: B023
    for k in (1.0, 2.0):
        found.append(tracing.carried(lambda s: k * s)(1.0))  # noqa: B023
    assert found == [1.0, 2.0, 3.0, 1.0, 2.0]


def test_what_may_change_is_itself_alone():
    for held in ([1.0], np.ones(2), {"k": 1.0}, io.StringIO()):
        one, other = ((lambda s, held=held: (held, s)) for _ in range(2))
        assert tracing.carried(one).func is one and tracing.carried(other).func is other
