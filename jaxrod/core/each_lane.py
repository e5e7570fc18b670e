"""What is written for one scene, as energies and forces are, evaluated in every lane.  Knows no rods.

The program of a function is walked operation by operation, so that the lane stays the last axis: `vmap` would move it.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import core
from jaxtyping import Array

from .lanes import lanes_of, spread, summed, widened


def lanewise(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function of pytrees of laned arrays, in every lane.

    It walks the function's jaxpr.

    >>> import jax, jax.numpy as jnp
    >>> from jaxrod.core.each_lane import lanewise
    >>> energy = lambda q: jnp.sqrt(q @ q)
    >>> print(lanewise(jax.grad(energy))(jnp.array([[3.0, 6.0], [4.0, 8.0]])))
    [[0.6 0.6]
     [0.8 0.8]]
    """

    def evaluate(*args):
        leaves, tree = jax.tree.flatten(args)
        shapes = [jax.ShapeDtypeStruct(x.shape[:-1], x.dtype) for x in leaves]
        # JAX keeps what it traced of one and the same function: the stages of a step trace their force once.
        closed, out = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(tree, shapes))
        found = _evaluate(closed.jaxpr, spread(closed.consts), leaves)
        return jax.tree.unflatten(jax.tree.structure(out), found)

    return evaluate


def _evaluate(jaxpr, consts: list[Array], args: list[Array]) -> list[Array]:
    known = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args], strict=True))

    def read(atom) -> Array:
        return spread(atom.val) if isinstance(atom, core.Literal) else known[atom]

    for eqn in jaxpr.eqns:
        for var, x in zip(eqn.outvars, _operation(eqn, [read(x) for x in eqn.invars]), strict=True):
            known[var] = x
    return [read(x) for x in jaxpr.outvars]


def _operation(eqn, laned: list[Array]) -> list[Array]:
    name, params = eqn.primitive.name, eqn.params
    if name in _INNER:
        inner = next(params[key] for key in ("jaxpr", "call_jaxpr") if key in params)
        inner = inner if isinstance(inner, core.ClosedJaxpr) else core.ClosedJaxpr(inner, ())
        return _evaluate(inner.jaxpr, spread(inner.consts), laned)
    if name in _ON_LEADING_AXES:
        return [_ON_LEADING_AXES[name](params, eqn.outvars[0].aval.shape, *laned)]
    if name == "reduce_sum":
        return [summed(laned[0], params["axes"])]
    if name.startswith("reduce_") and len(laned) == 1:
        return [eqn.primitive.bind(*laned, **params)]  # of axes before the last
    if (
        len(eqn.outvars) == 1
        and all(x.shape[:-1] in ((), eqn.outvars[0].aval.shape) for x in laned)
        and name in _ELEMENTWISE
    ):
        shape = jnp.broadcast_shapes(*(x.shape for x in laned))
        return [eqn.primitive.bind(*(jnp.broadcast_to(x, shape) for x in laned), **params)]
    return _mapped(eqn, laned)


def _mapped(eqn, laned: list[Array]) -> list[Array]:
    """Whatever else: by JAX, as what has derivative rules of its own."""
    known = {var: x for var, x in zip(eqn.invars, laned, strict=True) if not isinstance(var, core.Literal)}
    alone = core.jaxpr_as_fun(core.ClosedJaxpr(core.Jaxpr((), list(known), eqn.outvars, [eqn], eqn.effects), ()))
    alike = [x.shape[-1] == 1 for x in known.values()]
    arrays = [x[..., 0] if one else x for x, one in zip(known.values(), alike, strict=True)]
    if all(alike):
        return [x[..., None] for x in alone(*arrays)]
    return jax.vmap(alone, in_axes=[None if one else -1 for one in alike], out_axes=-1)(*arrays)


def _broadcast(params, shape, x):
    size = [1] * len(shape)
    for axis, extent in zip(params["broadcast_dimensions"], x.shape, strict=False):
        size[axis] = extent
    lanes = x.shape[-1]
    return jnp.broadcast_to(x.reshape(*size, lanes), (*shape, lanes))


def _dot(params, shape, left, right):
    """By products and their sum: a call of a matrix product would end the one compiled loop."""
    (sum_left, sum_right), (batch_left, batch_right) = params["dimension_numbers"]
    rest_left = [a for a in range(left.ndim - 1) if a not in (*sum_left, *batch_left)]
    rest_right = [a for a in range(right.ndim - 1) if a not in (*sum_right, *batch_right)]
    a = left.transpose([*sum_left, *batch_left, *rest_left, left.ndim - 1])
    b = right.transpose([*sum_right, *batch_right, *rest_right, right.ndim - 1])
    count, batch = len(sum_left), len(batch_left)
    a = a.reshape(*a.shape[:-1], *[1] * len(rest_right), a.shape[-1])
    b = b.reshape(*b.shape[: count + batch], *[1] * len(rest_left), *b.shape[count + batch :])
    found = summed(a * b, range(count))
    return found.reshape(*shape, found.shape[-1])


def _slice(params, shape, x):
    del shape
    strides = params["strides"] or [1] * (x.ndim - 1)
    return x[tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _joined(params, shape, *laned):
    del shape
    return jnp.concatenate(widened(laned, lanes_of(laned)), axis=params["dimension"])


def _padded(params, shape, x, value):
    del shape
    lanes = lanes_of((x, value))
    if value.shape[-1] > 1:
        config = params["padding_config"]
        return jax.vmap(lambda x, v: jax.lax.pad(x, v, config), in_axes=-1, out_axes=-1)(*widened((x, value), lanes))
    return jax.lax.pad(x, value[0], (*params["padding_config"], (0, 0, 0)))


_INNER = {"jit", "pjit", "closed_call", "core_call", "remat", "checkpoint"}
_ON_LEADING_AXES: dict[str, Callable[..., Array]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": _joined,
    "dot_general": _dot,
    "pad": _padded,
    "reshape": lambda params, shape, x: x.reshape(*shape, x.shape[-1]),
    "slice": _slice,
    "squeeze": lambda params, shape, x: x.reshape(*shape, x.shape[-1]),
    "transpose": lambda params, shape, x: x.transpose(*params["permutation"], x.ndim - 1),
}
_ELEMENTWISE = {
    "abs", "acos", "add", "add_any", "and", "asin", "atan", "atan2", "cbrt", "ceil", "convert_element_type", "copy", "cos",
    "cosh", "div", "eq", "erf", "exp", "exp2", "expm1", "floor", "ge", "gt", "integer_pow", "is_finite", "le", "log", "log1p",
    "logistic", "lt", "max", "min", "mul", "ne", "neg", "not", "or", "pow", "rem", "rsqrt", "select_n", "sign", "sin", "sinh",
    "sqrt", "square", "stop_gradient", "sub", "tan", "tanh", "xor",
}  # fmt: skip
