"""Scenes side by side in arrays whose last axis is the *lane*, one scene to each.  Knows no rods.

A loop over time works on whole vectors where the lane is the last axis: `vmap` would put it first, and the numbers of a
scene would lie strided in memory.  So a loop is written for lanes, `over_lanes` makes of it a function whose `vmap` adds
lanes, and `core/each_lane.py` evaluates within it what is written for one scene.

An array whose last axis is 1 is alike in all lanes.
"""

import functools
from collections.abc import Callable, Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

_FEW = 3


def spread(tree: Any) -> Any:
    """A scene's arrays, in a lane of their own."""
    return jax.tree.map(lambda x: jnp.asarray(x)[..., None], tree)


def alone(tree: Any) -> Any:
    """The arrays of the only lane."""
    return jax.tree.map(lambda x: x[..., 0], tree)


def lanes_of(tree: Any) -> int:
    """How many lanes there are."""
    return max((x.shape[-1] for x in jax.tree.leaves(tree)), default=1)


def widened(tree: Any, lanes: int) -> Any:
    """The same arrays with a number of its own for each lane."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-1], lanes)), tree)


def summed(x: Array, axes: Iterable[int] = (0,)) -> Array:
    """The sum over some axes; of a few numbers written out, which XLA fuses with what comes before and after."""
    axes = tuple(axes)
    if len(axes) != 1 or x.shape[axes[0]] > _FEW:
        return jnp.sum(x, axis=axes)
    rows = jnp.moveaxis(x, axes[0], 0)
    return functools.reduce(jnp.add, rows) if len(rows) else jnp.zeros(rows.shape[1:], x.dtype)


def laned(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of laned arrays, to which a number a lane, (lanes,), counts for all rows of (n, lanes) as NumPy has it."""

    @functools.wraps(function)
    def evaluate(*args):
        with jax.numpy_rank_promotion("allow"):
            return function(*args)

    return evaluate


# ---- many scenes


def over_lanes(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of pytrees of laned arrays, under whose `vmap` scenes become further lanes; it has forward derivatives.

    `function` closes over nothing that is traced, and all that it returns has all lanes.

    >>> import jax, jax.numpy as jnp
    >>> from jaxrod.core.lanes import alone, over_lanes, spread
    >>> total = over_lanes(lambda x: jnp.sum(x**2, axis=0))
    >>> print(jax.vmap(lambda x: alone(total(spread(x))))(jnp.array([[3.0, 4.0], [6.0, 8.0]])))
    [ 25. 100.]
    """

    def evaluate(*args):
        leaves, tree = jax.tree.flatten(args)
        shape: list[Any] = []

        def flat(*leaves):
            found, out = jax.tree.flatten(laned(function)(*jax.tree.unflatten(tree, leaves)))
            shape[:] = [out]
            return [found]

        (found,) = _over_lanes(flat, [set(range(len(leaves)))])(*leaves)
        return jax.tree.unflatten(shape[0], found)

    return evaluate


def _over_lanes(function: Callable[..., list[list[Array]]], needs: list[set[int]]) -> Callable[..., list[list[Array]]]:
    """The same of arrays, that returns groups of them, each of which depends on those arguments that it `needs`.

    So a run whose derivatives along several ways are asked for is itself alike for all of them.
    """

    @custom_vmap
    def folded(*arrays):
        return function(*arrays)

    @folded.def_vmap
    def _(size, batched, *arrays):
        lanes = lanes_of(arrays)
        groups = folded(*(_folded(x, many, size, lanes) for x, many in zip(arrays, batched, strict=True)))
        moving = [any(batched[i] for i in need) for need in needs]

        def unfolded(x, moves):
            x = x.reshape(*x.shape[:-1], size, lanes)
            return jnp.moveaxis(x, -2, 0) if moves else x[..., 0, :]

        out = [[unfolded(x, moves) for x in group] for group, moves in zip(groups, moving, strict=True)]
        return out, [[moves] * len(group) for group, moves in zip(groups, moving, strict=True)]

    @jax.custom_jvp
    def call(*arrays):
        return folded(*arrays)

    def along(arrays, tangents):
        moved = [i for i, x in enumerate(tangents) if not isinstance(x, SymbolicZero)]

        def both(*numbers):
            at, by = list(numbers[: len(arrays)]), numbers[len(arrays) :]
            pairs = [widened((at[i], x), lanes_of((at[i], x))) for i, x in zip(moved, by, strict=True)]
            places, ways = [place for place, _ in pairs], [way for _, way in pairs]

            def of_moved(*some):
                known = dict(zip(moved, some, strict=True))
                return function(*(known.get(i, x) for i, x in enumerate(at)))

            out, rates = jax.jvp(of_moved, places, ways)
            floats = [
                [rate for x, rate in zip(*group, strict=True) if _is_float(x)] for group in zip(out, rates, strict=True)
            ]
            return widened([*out, *floats], lanes_of(numbers))

        also = [need | {len(arrays) + k for k, i in enumerate(moved) if i in need} for need in needs]
        found = _over_lanes(both, [*needs, *also])(*arrays, *(tangents[i] for i in moved))
        out, left = found[: len(needs)], iter(jax.tree.leaves(found[len(needs) :]))
        return out, [[next(left) if _is_float(x) else np.zeros(x.shape, jax.dtypes.float0) for x in g] for g in out]

    call.defjvp(along, symbolic_zeros=True)
    return call


def _folded(x, many: bool, size: int, lanes: int) -> Array:
    """The lanes of several scenes, (size, ..., lanes or 1), as (..., size * lanes); of what is alike in all (..., 1)."""
    if not many and x.shape[-1] == 1:
        return x
    x = jnp.broadcast_to(jnp.moveaxis(x, 0, -2) if many else x[..., None, :], (*x.shape[many:-1], size, lanes))
    return x.reshape(*x.shape[:-2], size * lanes)


def _is_float(x: Array) -> bool:
    return jnp.issubdtype(x.dtype, jnp.inexact)
