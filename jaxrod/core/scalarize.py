"""Arithmetic number by number, so that under `vmap` every number becomes a vector of lanes.  Knows no rods.

A small array (N,) mapped over many scenes is laid out (scenes, N): each of its numbers lies strided in memory, and XLA
cannot keep it in vector registers.  N separate numbers become N contiguous vectors.  `by_number` evaluates a function
that was written for arrays in that way: it walks the function's jaxpr and turns each operation on arrays into operations
on their numbers.  Nothing is approximated, and every derivative goes through, but rules of `custom_jvp` and `custom_vjp` within
the function: their bodies are evaluated.
"""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jaxtyping import Array

from .scalar_arithmetic import Arithmetic, plain

_LONG = 64  # numbers of a constant, beyond which it stays an array


class Undivided(eqx.Module):
    """A module whose arrays stay arrays: tables that are looked up in, all of whose numbers no lane needs at once."""


@jax.tree_util.register_pytree_node_class
class Numbers:
    """An array as its separate numbers: a pytree of scalars."""

    def __init__(self, values: Any, shape: tuple[int, ...]):
        self.values, self.shape = tuple(values), shape

    def tree_flatten(self):
        return self.values, self.shape

    @classmethod
    def tree_unflatten(cls, shape, values):
        return cls(values, shape)

    def __getitem__(self, index):
        """One number, or the Numbers of a slice."""
        picked = self.table()[index]
        return Numbers(picked.flat, picked.shape) if isinstance(picked, np.ndarray) else picked

    def __iter__(self):
        return iter(self.values)

    def __len__(self):
        return self.shape[0]

    def like(self, values: Any) -> "Numbers":
        """Other numbers in the same shape."""
        return Numbers(values, self.shape)

    def moved(self, by, along: "Numbers") -> "Numbers":
        """These and `by` times those."""
        return self.like([x + by * u for x, u in zip(self.values, along.values, strict=True)])

    def table(self) -> np.ndarray:
        """The numbers as a NumPy array of objects."""
        table = np.empty(len(self.values), dtype=object)
        for i, x in enumerate(self.values):  # not at once: NumPy would look into each
            table[i] = x
        return table.reshape(self.shape)


def scattered(tree: Any) -> Any:
    """A pytree with every array of it as `Numbers`, but of what is `Undivided`; scalars stay."""
    return jax.tree.map(_scattered, tree, is_leaf=lambda x: isinstance(x, Undivided))


def gathered(tree: Any) -> Any:
    """A pytree with all `Numbers` of it as arrays."""
    return jax.tree.map(
        lambda x: _stacked(x.table()) if isinstance(x, Numbers) else x, tree, is_leaf=lambda x: isinstance(x, Numbers)
    )


def by_number(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function of pytrees that hold `Numbers` where `function` takes arrays.

    >>> import jax, jax.numpy as jnp
    >>> from jaxrod.core.scalarize import by_number, scattered
    >>> energy = lambda q: jnp.sqrt(q @ q)
    >>> print(by_number(jax.grad(energy))(scattered(jnp.array([3.0, 4.0])))[1])
    0.8
    """

    def evaluate(*args):
        leaves, tree = jax.tree.flatten(args, is_leaf=lambda x: isinstance(x, Numbers))
        shapes = [jax.ShapeDtypeStruct(np.shape(_table(x)), _dtype(x)) for x in leaves]
        # JAX keeps what it traced of one and the same function: the stages of a step trace their force once.
        closed, out = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(tree, shapes))
        tables = _evaluate(
            closed.jaxpr, [_constant(c) for c in closed.consts], [_table(x) for x in leaves], Arithmetic()
        )
        tables = [_scattered_table(t) if _is_whole(t) else t for t in tables]
        results = [Numbers(map(plain, t.flat), t.shape) if t.ndim else plain(t.item()) for t in tables]
        return jax.tree.unflatten(jax.tree.structure(out), results)

    return evaluate


def _dtype(x):
    return (
        jnp.result_type(*x.values)
        if isinstance(x, Numbers) and x.values
        else jnp.result_type(float)
        if isinstance(x, Numbers)
        else jnp.result_type(x)
    )


def _table(x) -> Any:
    return x.table() if isinstance(x, Numbers) else _scattered_table(x) if np.ndim(x) == 0 else jnp.asarray(x)


def _constant(x) -> Any:
    return _scattered_table(x) if np.size(x) <= _LONG else jnp.asarray(x)


def _is_whole(table: Any) -> bool:
    """Whether a table of numbers is an array: nothing looks at its numbers one by one."""
    return isinstance(table, jax.Array)


def _scattered(x):
    return x if isinstance(x, Undivided) or np.ndim(x) == 0 else Numbers(_scattered_table(x).flat, np.shape(x))


def _scattered_table(x: Any) -> np.ndarray:
    table = np.empty(np.shape(x), dtype=object)
    if isinstance(x, np.ndarray | np.generic | float | int | bool):
        for index in np.ndindex(table.shape):
            table[index] = np.asarray(x)[index]
        return table
    for index in np.ndindex(table.shape):
        table[index] = x[index] if index else x
    return table


def _stacked(table: np.ndarray) -> Array:
    return (
        jnp.stack([jnp.asarray(plain(x)) for x in table.flat]).reshape(table.shape)
        if table.size
        else jnp.zeros(table.shape)
    )


def _evaluate(jaxpr, consts: list[np.ndarray], args: list[np.ndarray], arithmetic: Arithmetic) -> list[np.ndarray]:
    known = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args], strict=True))

    def read(atom) -> np.ndarray:
        return _scattered_table(atom.val) if isinstance(atom, core.Literal) else known[atom]

    for eqn in jaxpr.eqns:
        for var, table in zip(eqn.outvars, _operation(eqn, [read(x) for x in eqn.invars], arithmetic), strict=True):
            known[var] = table
    return [read(x) for x in jaxpr.outvars]


def _operation(eqn, tables: list[np.ndarray], arithmetic: Arithmetic) -> list[np.ndarray]:
    name, params = eqn.primitive.name, eqn.params
    shape: Any = eqn.outvars[0].aval.shape if eqn.outvars else None  # a debug print gives nothing
    if name in _INNER:
        inner = next(params[key] for key in ("jaxpr", "call_jaxpr", "fun_jaxpr") if key in params)
        inner = inner if isinstance(inner, core.ClosedJaxpr) else core.ClosedJaxpr(inner, ())
        return _evaluate(inner.jaxpr, [_constant(c) for c in inner.consts], tables, arithmetic)
    if any(map(_is_whole, tables)):
        return [_constant(x) for x in _on_arrays(eqn, tables)]
    if name in _MOVES:
        return [_MOVES[name](params, shape, *tables)]
    if name in ("split", "unstack"):
        axis = params["axis"]
        ends = np.cumsum(params["sizes"])[:-1] if name == "split" else tables[0].shape[axis]
        return [
            part.reshape(var.aval.shape) for part, var in zip(np.split(tables[0], ends, axis), eqn.outvars, strict=True)
        ]
    if name == "dot_general":
        return [_dot(params, arithmetic, *tables)]
    if name == "reduce_sum":
        return [_sum(tables[0], params["axes"], arithmetic)]
    if name in _ELEMENTWISE and all(np.shape(t) in ((), shape) for t in tables):
        out = np.empty(shape, dtype=object)
        for index in np.ndindex(shape):
            out[index] = arithmetic(eqn, [t[index] if t.ndim else t.item() for t in tables])
        return [out]
    return [_scattered_table(x) for x in _on_arrays(eqn, tables)]


def _on_arrays(eqn, tables: list) -> list[Array]:
    """Whatever else: on arrays, as it was written."""
    arrays = [t if _is_whole(t) else _stacked(t) if t.ndim else plain(t.item()) for t in tables]
    found = eqn.primitive.bind(*arrays, **eqn.params)
    return found if eqn.primitive.multiple_results else [found]


_INNER = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint"}

_ELEMENTWISE = set(
    [
        "add",
        "add_any",
        "sub",
        "mul",
        "div",
        "neg",
        "sign",
        "abs",
        "square",
        "sqrt",
        "rsqrt",
        "cbrt",
        "integer_pow",
        "pow",
        "exp",
        "exp2",
        "log",
        "log1p",
        "expm1",
        "sin",
        "cos",
        "tan",
        "tanh",
        "sinh",
        "cosh",
        "asin",
        "acos",
        "atan",
        "atan2",
        "max",
        "min",
        "rem",
        "select_n",
        "clamp",
        "lt",
        "le",
        "gt",
        "ge",
        "eq",
        "ne",
        "and",
        "or",
        "not",
        "xor",
        "is_finite",
        "floor",
        "ceil",
        "round",
        "convert_element_type",
        "copy",
        "copy_p",
        "stop_gradient",
        "real",
        "imag",
        "erf",
        "logistic",
        "nextafter",
    ]
)


def _pad(params, shape, table, value):
    del shape
    config = params["padding_config"]
    if any(low < 0 or high < 0 for low, high, _ in config):
        low = [
            slice(max(0, -low), size - max(0, -high)) for (low, high, _), size in zip(config, table.shape, strict=True)
        ]
        table = table[tuple(low)]
    out = np.full(
        [
            max(0, low) + (size - 1) * (inner + 1) + 1 + max(0, high)
            for (low, high, inner), size in zip(config, table.shape, strict=True)
        ],
        value.item(),
        dtype=object,
    )
    out[
        tuple(
            slice(max(0, low), max(0, low) + (size - 1) * (inner + 1) + 1, inner + 1)
            for (low, _, inner), size in zip(config, table.shape, strict=True)
        )
    ] = table
    return out


def _broadcast(params, shape, table):
    size = [1] * len(shape)
    for axis, extent in zip(params["broadcast_dimensions"], table.shape, strict=True):
        size[axis] = extent
    bent = table.reshape(size)
    return np.broadcast_to(bent, shape)


def _slice(params, shape, table):
    del shape
    steps = params["strides"] or [1] * table.ndim
    return table[tuple(map(slice, params["start_indices"], params["limit_indices"], steps))]


_MOVES: dict[str, Callable[..., np.ndarray]] = {
    "broadcast_in_dim": _broadcast,
    "reshape": lambda params, shape, table: table.reshape(shape),
    "squeeze": lambda params, shape, table: table.reshape(shape),
    "expand_dims": lambda params, shape, table: table.reshape(shape),
    "concatenate": lambda params, shape, *tables: np.concatenate(tables, axis=params["dimension"]),
    "transpose": lambda params, shape, table: table.transpose(params["permutation"]),
    "rev": lambda params, shape, table: np.flip(table, params["dimensions"]),
    "slice": _slice,
    "pad": _pad,
    "stack": lambda params, shape, *tables: np.stack(tables, axis=params["axis"]),
}


def _dot(params, arithmetic, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    (sum_left, sum_right), (batch_left, batch_right) = params["dimension_numbers"]
    rest_left = [a for a in range(left.ndim) if a not in (*sum_left, *batch_left)]
    rest_right = [a for a in range(right.ndim) if a not in (*sum_right, *batch_right)]
    a = left.transpose([*batch_left, *rest_left, *sum_left])
    b = right.transpose([*batch_right, *rest_right, *sum_right])
    batch = a.shape[: len(batch_left)]
    rows, columns = (
        a.shape[len(batch) : len(batch) + len(rest_left)],
        b.shape[len(batch) : len(batch) + len(rest_right)],
    )
    size = math.prod(left.shape[k] for k in sum_left)
    a, b = a.reshape(*batch, math.prod(rows), size), b.reshape(*batch, math.prod(columns), size)
    out = np.empty((*batch, a.shape[-2], b.shape[-2]), dtype=object)
    for index in np.ndindex(out.shape):
        out[index] = arithmetic.total(
            [arithmetic.product(x, y) for x, y in zip(a[index[:-1]], b[(*index[:-2], index[-1])], strict=True)]
        )
    return out.reshape((*batch, *rows, *columns))


def _sum(table: np.ndarray, axes, arithmetic: Arithmetic) -> np.ndarray:
    rest = [a for a in range(table.ndim) if a not in axes]
    shape = tuple(table.shape[a] for a in rest)
    flat = table.transpose([*rest, *axes]).reshape(*shape, math.prod(table.shape[a] for a in axes))
    out = np.empty(shape, dtype=object)
    for index in np.ndindex(shape):
        out[index] = arithmetic.total(flat[index])
    return out
