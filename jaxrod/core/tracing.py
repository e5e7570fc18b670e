"""Which traced numbers decide where a function of s is divided, as b does in where(s < b, ...).

By the place of a jump automatic differentiation finds a derivative of zero: nothing it knows depends on b.
"""

from typing import Any

import equinox as eqx
import jax
from jax.core import Tracer
from jaxtyping import Array, Inexact

from . import validation

_ALONG = frozenset(["s"])
_STEPPED = {"floor", "ceil", "round", "sign", "rem"}  # steps in floating point; comparisons and integers step anyway


def traced(part: Any) -> bool:
    """Whether a number in its pytree, or in its closures, is traced."""
    return any(isinstance(x, Tracer) for x in jax.tree.leaves(part)) or validation.closes_over_traced(part)


def deciding(part: Any, s: Any) -> list[Inexact[Array, "..."]]:
    """The traced numbers in part(s), of its pytree and of its closures, that are compared with s."""
    numbers, rest = eqx.partition(part, eqx.is_array)
    leaves, structure = jax.tree.flatten(numbers)
    if not traced(part):
        return []

    def values(leaves, s):
        return eqx.combine(jax.tree.unflatten(structure, leaves), rest)(s)

    closed = jax.make_jaxpr(values)(leaves, s)
    given = [*leaves, *closed.consts]
    names = [frozenset([k]) if isinstance(x, Tracer) else frozenset() for k, x in enumerate(given)]
    _, found = _followed(closed.jaxpr, [*names[: len(leaves)], _ALONG], names[len(leaves) :])
    return [given[k] for k in sorted(found) if eqx.is_inexact_array(given[k])]


def _followed(jaxpr: Any, inputs: list, constants: Any = None) -> tuple[list, frozenset]:
    """What the outputs of a program depend on, and what is compared with s in it."""
    depends = dict(zip(jaxpr.invars, inputs, strict=True))
    depends.update(zip(jaxpr.constvars, constants or [frozenset()] * len(jaxpr.constvars), strict=True))
    found = frozenset()

    def of(x):
        return frozenset() if hasattr(x, "val") else depends[x]

    for equation in jaxpr.eqns:
        each = [of(x) for x in equation.invars]
        union = frozenset().union(*each)
        outputs = [union] * len(equation.outvars)
        inner = [x for value in equation.params.values() for x in _programs(value)]
        for program in inner:
            # A call passes its arguments on; of loops and branches everything may depend on everything.
            call = len(inner) == 1 and equation.primitive.name != "scan" and len(program.invars) == len(each)
            results, compared = _followed(program, each if call else [union] * len(program.invars))
            outputs, found = results if call else outputs, found | compared
        stepped = equation.primitive.name in _STEPPED or any(_exact(x) for x in equation.outvars)
        if not inner and stepped and union >= _ALONG:
            found |= union - _ALONG
        depends.update(zip(equation.outvars, outputs, strict=True))
    return [of(x) for x in jaxpr.outvars], found


def _programs(value: Any) -> list:
    """The jaxprs in a parameter of an equation."""
    if isinstance(value, tuple | list):
        return [program for x in value for program in _programs(x)]
    value = getattr(value, "jaxpr", value)
    return [value] if hasattr(value, "eqns") else []


def _exact(variable: Any) -> bool:
    return not jax.numpy.issubdtype(getattr(variable.aval, "dtype", float), jax.numpy.inexact)
