"""Programs for few runs are compiled sooner, and one for all functions that are alike."""

import collections
import sys

import equinox as eqx
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


def test_where_operations_of_known_numbers_are_traced():
    x = np.arange(3.0)  # no tracer, though jit traces what is done with it
    run = tracing.run_seldom(_wave)
    np.testing.assert_allclose(jax.jit(lambda: run(2.0, x))(), _wave(2.0, x), rtol=1e-15)


WAYS = {
    "jit": jax.jit,
    "vmap": jax.vmap,
    "grad": jax.grad,
    "jacfwd": jax.jacfwd,
    "both": lambda f: jax.jit(jax.vmap(f)),
}


@pytest.mark.parametrize("way", WAYS)
def test_under_transformations(way):
    given = jnp.asarray(0.7) if way in ("grad", "jacfwd") else jnp.array([0.7])
    run = tracing.run_seldom(_wave)
    found, expected = (WAYS[way](lambda x, f=f: f(2.0, x))(given) for f in (run, _wave))
    np.testing.assert_allclose(found, expected, rtol=1e-14)


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


def _compiled(functions):
    """What a program makes of each, one after the other."""
    run = eqx.filter_jit(lambda function, x: function(x))
    return [float(run(tracing.carried(function), 1.0)) for function in functions]


def test_numbers_tell_functions_apart():
    def made(k):
        return [lambda s: k * s, lambda s, k=k: k * s, lambda s: jnp.exp(k) * max(s, 1.0)]

    for one, same, other in zip(made(1.0), made(1.0), made(2.0), strict=True):
        told = [tracing.carried(f).func for f in (one, same, other)]
        assert told[0] is told[1] is not told[2]
    for one, other in ((0.0, -0.0), (1, 1.0), (True, 1), (np.float32(1), np.float64(1))):
        assert tracing.carried(made(one)[0]).func is not tracing.carried(made(other)[0]).func


_SLOPE = 1.0
Pair = collections.namedtuple("Pair", "a b")
Riap = collections.namedtuple("Riap", "b a")


def test_variables_that_change(monkeypatch):
    """A function never stands for what another reads now, nor for what it read itself before it was compiled."""

    def made():
        return lambda s: _SLOPE * s

    slopes = []
    for slope in (1.0, 2.0, 1.0):
        monkeypatch.setattr(sys.modules[__name__], "_SLOPE", slope)
        slopes += _compiled([made()])
    assert slopes == [1.0, 2.0, 1.0]
    waiting = [tracing.carried(lambda s: k * s) for k in (1.0, 2.0)]  # noqa: B023, each with its own number
    assert _compiled(waiting) == [1.0, 2.0]
    assert _compiled(lambda s: k * s for k in (1.0, 2.0)) == [1.0, 2.0]  # noqa: B023


def _helper(s):
    return s


def test_what_may_change_is_itself_alone():
    """Lists, arrays, other functions, what is imported within, what it writes, attributes of its own."""

    def counting():
        count = 0

        def counted(s):
            nonlocal count
            count += 1
            return s

        return counted

    def importing(s):
        import math

        return math.pi * s

    def marked(s):
        return s

    vars(marked)["k"] = 1.0
    held = [[1.0], np.ones(2), jnp.ones(2), {"k": 1.0}, Pair(1.0, 2.0), Riap(1.0, 2.0), _helper, lambda s: s, None]
    holding = [lambda s, x=x: (x, s) for x in held]
    others = [
        lambda s: _helper(s),
        lambda s: globals()["_SLOPE"] * s,
        eval("lambda s: not_there_yet(s)"),
        lambda s: (lambda x: x)(s),
    ]
    for function in (*holding, *others, counting(), importing, marked, jax.jit(_helper), len):
        assert tracing.carried(function).func is function


def test_it_keeps_its_name_and_its_derivative():
    k = 2.0

    def load(s):
        return k * jnp.sin(s)

    found = tracing.carried(load).func
    assert found is not load and (found.__name__, found.__module__) == ("load", __name__)
    assert jax.grad(found)(0.0) == 2.0


@pytest.mark.parametrize("depth", [0, 3, 6])
def test_a_traced_number_deep_in_closures(depth, scene):
    def section(k):
        area = lambda s: 1e-3 * (1 + k * s)  # noqa: E731
        for _ in range(depth):
            area = (lambda inner: lambda s: inner(s))(area)
        return area

    def frequency(k):
        return jaxrod.natural_frequencies(scene(section=section(k)))[0]

    quotient = (frequency(0.501) - frequency(0.499)) / 0.002
    np.testing.assert_allclose(jax.grad(frequency)(0.5), quotient, rtol=1e-5)


_GLOBAL = []


def test_a_traced_number_in_a_global():
    run = tracing.run_seldom(lambda x: _GLOBAL[-1] * x**2)

    def value(k):
        _GLOBAL.append(k)
        return run(jnp.asarray(3.0))

    assert jax.grad(value)(1.0) == 9.0
    _GLOBAL.clear()
