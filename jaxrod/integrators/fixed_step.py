"""Equal steps of a symplectic solver from one save time to the next, and their derivative by undoing them.

Each stage of a step can be undone exactly, to rounding: from where it ended back to where it began.  So the reverse
derivative needs no stored states: its memory does not grow with the number of steps.
"""

import functools
import itertools
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .compensation import passed
from .reversal import ONCE, reversible
from .splitting import AbstractSplit, AbstractStepped, Split

COLLAPSED, DIVERGED, COARSE, NON_FINITE, CUT = 1, 2, 3, 4, 5
_LEAST_STRAIN, _LARGEST_STRAIN = -1 + 1e-6, 1e6
_LOOK = 4  # every so many steps of those written out together it is seen how far the rod turned
_NEAR = 1e-6  # square of the distance from the pivot, over the length, that a step may not tell from none


class Walker(NamedTuple):
    """A run on its way: phase, full turns made, why it stopped (0: it did not), the time it reached, and the least strain
    on the way."""

    y: Split
    turns: Float[Array, ""]
    stopped: Int[Array, ""]
    t: Float[Array, ""]
    lowest: Float[Array, ""]


class Route(eqx.Module):
    """Save times `ends` (T,) after `start`, `counts` (T,) steps to each, of which `taken` (T,) are taken; `even`: all of
    one size."""

    start: Float[Array, ""]
    ends: Float[Array, " T"]
    counts: Int[Array, " T"]
    taken: Int[Array, " T"]
    even: bool = eqx.field(static=True)


def march(solver: Any, split: AbstractStepped, y0: Split, turns, route: Route, backwards: bool) -> Walker:
    """The walker at each of `route.ends`, stacked.  A run that stops stays where it was; with a past it is lost.

    `backwards`: have the reverse derivative undo the steps; there is no forward derivative then.
    """
    start = Walker(y0, turns, jnp.zeros((), jnp.int32), route.start, jnp.zeros_like(route.start))
    even_h = (route.ends[-1] - route.start) / jnp.maximum(jnp.sum(route.counts.astype(route.ends.dtype)), 1)
    even = (even_h, split.table(solver, even_h)) if route.even else None
    # Between steps of one size a past is kept; to make a new one takes longer than the steps of a leg.
    kept_open = split.has_past and route.even
    go = _walk_reversible if backwards else _walk

    def leg(walker, ends):
        begin, end, count, taken = ends
        h = jnp.where(count > 0, (end - begin) / jnp.maximum(count, 1), 0.0)
        h, table = (h, split.table(solver, h)) if even is None else even
        counted = jax.lax.stop_gradient(walker._replace(y=None))
        if kept_open:
            walker = _stepped(split, solver, table, begin, h, walker, taken)
            seen = walker._replace(y=split.closed(solver, table, walker.t, h, walker.y))
        else:
            walker = seen = go((split, begin, h, walker.y), solver, table, counted, taken)
        stopped = jnp.where((walker.stopped == 0) & (taken < count), CUT, walker.stopped)
        return walker._replace(stopped=stopped), _packed(seen._replace(stopped=stopped))

    legs = (jnp.concatenate([route.start[None], route.ends[:-1]]), route.ends, route.counts, route.taken)
    begun = start._replace(y=split.opened(solver, even[1], route.start, even_h, y0)) if kept_open and even else start
    return jax.vmap(lambda row: _unpacked(row, start))(_in_blocks(leg, begun, legs))


def _in_blocks(leg, start: Walker, legs) -> Float[Array, "T numbers"]:
    """A scan over `legs` in scans over some of them: of several arrays that a loop writes, as derivatives do, XLA may copy
    each as a whole for every row."""
    count = legs[0].shape[0]
    size = math.isqrt(count - 1) + 1
    padding = -count % size  # by legs of no steps

    def blocks(x):
        return jnp.pad(x, (0, padding), mode="edge" if jnp.issubdtype(x.dtype, jnp.floating) else "constant").reshape(
            -1, size
        )

    _, saved = jax.lax.scan(lambda walker, block: jax.lax.scan(leg, walker, block), start, jax.tree.map(blocks, legs))
    return saved.reshape(-1, saved.shape[-1])[:count]


def _packed(walker: Walker) -> Float[Array, " numbers"]:
    return jnp.stack([x.astype(walker.t.dtype) for x in jax.tree.leaves(walker)])


def _unpacked(row: Float[Array, " numbers"], like: Walker) -> Walker:
    leaves, structure = jax.tree.flatten(like)
    return jax.tree.unflatten(structure, [x.astype(leaf.dtype) for x, leaf in zip(row, leaves, strict=True)])


def _walk(moving, solver: Any, table: Any, walker: Walker, count) -> Walker:
    """`count` steps of one size; `moving` is (split, time, step, phase)."""
    split, begin, h, y = moving
    opened = _moved(split, walker._replace(y=y), split.opened(solver, table, begin, h, y))
    walker = _stepped(split, solver, table, begin, h, opened, count)
    return _moved(split, walker, split.closed(solver, table, begin + count * h, h, walker.y))


def _stepped(split: AbstractStepped, solver: Any, table: Any, begin, h, walker: Walker, count) -> Walker:
    """The walker after `count` steps, its phase opened for them before and after."""

    def body(size: int, carry):
        k, walker = carry
        here, path = _watched(split, [walker.y], walker, begin + k * h), [walker.y]
        for i in range(size):
            path.append(split.step(solver, table, begin + (k + i) * h, h, path[-1]))
        if size > 1:
            here = _watched(split, path[1:-1], here, begin + k * h)
        stopped, turns = here.stopped, walker.turns
        headings = [split.heading(y) for y in (*path[:-1:_LOOK], path[-1])]
        for before, after in itertools.pairwise(headings):
            if after is not None:
                stopped = jnp.where(stopped == 0, _strayed(before, after), stopped)
                turns = turns + passed(before, after)
        y, going = path[-1], stopped == 0
        if not split.has_past:  # a past goes on, into nothing: to hold it takes as long as the steps
            y = jax.tree.map(lambda new, old: jnp.where(going, new, old), y, walker.y)
        turns = jnp.where(going, turns, walker.turns)
        return k + size, Walker(y, turns, stopped, here.t, here.lowest)

    carry, size = (jnp.zeros_like(count), walker), split.steps_at_once(solver)
    if size > 1:
        carry = jax.lax.while_loop(lambda carry: carry[0] + size <= count, functools.partial(body, size), carry)
    _, walker = jax.lax.while_loop(lambda carry: carry[0] < count, functools.partial(body, 1), carry)
    end = begin + count * h
    walker = _watched(split, [walker.y], walker, end)
    return walker._replace(t=jnp.where(walker.stopped == 0, end, walker.t))


def _moved(split: AbstractStepped, walker: Walker, y) -> Walker:
    """The walker at y, which may be on the other side of where turns are counted."""
    before, after = split.heading(walker.y), split.heading(y)
    return walker._replace(y=y, turns=walker.turns if after is None else walker.turns + passed(before, after))


def _strayed(before, after) -> Int[Array, ""]:
    """Whether the rod turned too far in a step, or its straight way led through the pivot."""
    ahead = sum(a * b for a, b in zip(before, after, strict=True))
    sizes = sum(a * a for a in before) * sum(b * b for b in after)
    way = sum((a - b) ** 2 for a, b in zip(before, after, strict=True))
    through = (ahead < 0) & (sizes - ahead * ahead < _NEAR * way)
    return jnp.where((ahead > 0) & (2 * ahead * ahead > sizes), 0, jnp.where(through, COLLAPSED, COARSE))


def _watched(split: AbstractStepped, phases: list, walker: Walker, t) -> Walker:
    """The walker with the reason why it stops at one of `phases`, if it does.  What it does after that means nothing."""
    lowest = split.lowest_strain(phases)
    why = jnp.where(lowest > _LEAST_STRAIN, 0, COLLAPSED)
    why = jnp.where(jnp.abs(lowest) < _LARGEST_STRAIN, why, DIVERGED)
    newest = phases[-1].q if split.has_past else phases[-1]
    why = jnp.where(jnp.isfinite(sum(jax.tree.leaves(newest))), why, NON_FINITE)
    first = walker.stopped == 0
    return walker._replace(
        stopped=jnp.where(first, why, walker.stopped),
        t=jnp.where(first, t, walker.t),
        lowest=jnp.where(first, jnp.minimum(lowest, walker.lowest), walker.lowest),
    )


_walk_reversible = eqx.filter_custom_vjp(_walk)


def _there(perturbed, moving, solver, table, walker, count):
    del perturbed
    walker = _walk(moving, solver, table, walker, count)
    return walker, walker


def _and_back(arrived: Walker, gradient, perturbed, moving, solver, table, walker, count):
    """The gradients of `moving`: each stage is undone, then its derivative is taken where it began."""
    del walker
    begin, h = moving[1:3]
    asked, rest = eqx.partition(moving[0], jax.tree.map(bool, perturbed[0]))
    defined = jnp.where(arrived.stopped == 0, 1.0, jnp.nan)  # a run that stopped has no derivative
    y_bar = jax.tree.map(lambda x, bar: bar * defined.astype(x.dtype), arrived.y, gradient.y)

    def pulled(function, sums, t, k, y, y_bar):
        """`sums` and `y_bar` before `function` of (split, t, h, y), at the step k that begins at t."""
        _, pull = jax.vjp(lambda asked, t, h, y: function(eqx.combine(asked, rest), t, h, y), asked, t, h, y)
        asked_bar, t_bar, h_bar, y_bar = pull(y_bar)
        return jax.tree.map(jnp.add, sums, (asked_bar, t_bar, h_bar + k * t_bar)), y_bar

    def open_(split: AbstractSplit, t, h, y):
        return split.settled(split.opened(solver, table, t, h, y))

    def close(split: AbstractSplit, t, h, y):
        return split.closed(solver, table, t, h, y)

    def step(carry):
        k, y, y_bar, sums = carry
        k = k - 1
        t = begin + k * h

        def visit(carry, stage, known):
            y, y_bar, sums = carry
            y = moving[0].undone(stage, known, t, h, y)

            def ahead(split: AbstractSplit, t, h, y):
                return split.settled(split.stage(stage, known, t, h, y))

            sums, y_bar = pulled(ahead, sums, t, k, y, y_bar)
            return y, y_bar, sums

        return k, *moving[0].through(solver, table, visit, (y, y_bar, sums), backwards=True)

    sums = jax.tree.map(jnp.zeros_like, (asked, begin, h))
    y = open_(moving[0], begin, h, arrived.y)
    sums, y_bar = pulled(close, sums, begin, 0, y, y_bar)
    _, y, y_bar, sums = jax.lax.while_loop(lambda carry: carry[0] > 0, step, (count, y, y_bar, sums))
    (split_bar, begin_bar, h_bar), y_bar = pulled(open_, sums, begin, 0, close(moving[0], begin, h, y), y_bar)
    return reversible((split_bar, begin_bar, h_bar, y_bar), 0, ONCE)


_walk_reversible.def_fwd(_there)
_walk_reversible.def_bwd(_and_back)
