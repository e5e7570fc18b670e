"""Equal steps of a solver from one save time to the next, of many scenes side by side, and their derivative by undoing them.

Each stage of a splitting can be undone exactly, to rounding: from where it ended back to where it began.  So the reverse
derivative needs no stored states but those that are saved.
"""

import functools
import itertools
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core.lanes import alone, lanes_of, over_lanes, spread, summed, widened
from ..core.result import Result
from .compensation import passed
from .reversal import ONCE, reversible
from .splitting import AbstractSplitting, AbstractStepper, PhasePoint

_LEAST_STRAIN, _LARGEST_STRAIN = -1 + 1e-6, 1e6
_LOOK = 4  # every so many steps of those written out together it is seen how far the rod turned
_NEAR = 1e-6  # square of the distance from the pivot, over the length, that a step may not tell from none


class Walker(NamedTuple):
    """A run on its way: phase, full turns made, the `Result` that stopped it, the time it reached, and the least strain
    on the way."""

    y: PhasePoint
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

    def legs(self, length: int) -> tuple[Array, Array, Array, Array]:
        """Laned: when each leg begins, the size of its steps, how many and how many are taken; followed by legs of no steps, so
        that there are `length`."""

        def padded(x):
            mode = "edge" if jnp.issubdtype(x.dtype, jnp.floating) else "constant"
            return jnp.pad(x, ((0, length - x.shape[0]), (0, 0)), mode=mode)

        return jax.tree.map(padded, (*self.times(), self.counts, self.taken))

    def times(self) -> tuple[Array, Array]:
        """Laned: when each leg begins, and the size of its steps."""
        start, ends, counts = self.start, self.ends, self.counts.astype(self.ends.dtype)
        start, ends, counts = widened((start, ends, counts), lanes_of((start, ends, counts)))
        begins = jnp.concatenate([start[None], ends[:-1]])
        if not self.even:
            return begins, jnp.where(counts > 0, (ends - begins) / jnp.maximum(counts, 1), 0.0)
        h = (ends[-1] - start) / jnp.maximum(jnp.sum(counts, axis=0), 1)
        return begins, jnp.broadcast_to(h, counts.shape)


def march(
    solver: Any, split: AbstractStepper, y0: PhasePoint, turns, route: Route, check: Route | None, backwards: bool
) -> tuple[Walker, Walker | None]:
    """The walkers at each of `route.ends`, stacked, and those of `check`, another way from the same start with no more ends.

    A run that stops stays where it was; with a past it is lost.  `backwards`: have the reverse derivative undo the steps; there
    is no forward derivative then.  What `check` finds has none.
    """
    turns, route_known, check = jax.lax.stop_gradient((turns, route, check))
    moving = (split, y0, route.start, route.ends)
    if backwards:
        walkers, checked = _undoable(moving, solver, turns, route_known, check)
    else:  # the check in a loop of its own, without derivatives
        walkers, checked = _forwards(moving, solver, turns, route_known, None)[0], None
        if check is not None:
            still = jax.lax.stop_gradient((split, y0, check.start, check.ends))
            checked = _forwards(still, solver, turns, check, None)[0]
    return alone(walkers), None if checked is None else jax.lax.stop_gradient(alone(checked))


def _forwards(moving, solver: Any, turns, route: Route, check: Route | None) -> tuple[Walker, Walker | None]:
    split, y0, start, ends = moving
    route = eqx.tree_at(lambda r: (r.start, r.ends), route, (start, ends))
    arrays, rest = eqx.partition((split, y0, turns, route, check), eqx.is_array)
    return over_lanes(lambda arrays: _march(solver, *eqx.combine(arrays, rest)))(spread(arrays))


def _march(solver: Any, split: AbstractStepper, y0: PhasePoint, turns, route: Route, check: Route | None):
    """Laned: both ways as passes of one loop, whose program is the larger part of what is to be compiled."""
    lanes, count = lanes_of(eqx.filter((split, y0, turns, route, check), eqx.is_array)), route.ends.shape[0]
    none = jnp.zeros(lanes, route.ends.dtype)
    begin, lowest = widened(y0, lanes), split.lowest_strain([y0]) + none
    start = Walker(begin, turns + none, jnp.zeros(lanes, jnp.int32), route.start + none, lowest)
    size = math.isqrt(count - 1) + 1  # of a block of legs
    blocks = -(-count // size)
    legs = route.legs(size * blocks)
    if check is None:
        return _unpacked(_pass(solver, split, start, legs, size, blocks, route.even)[:count], start), None
    others = check.legs(size * blocks)
    width, fewer = lanes_of((legs, others)), -(-check.ends.shape[0] // size)
    both = jax.tree.map(lambda *x: jnp.stack(widened(x, width)), legs, others)
    even = route.even if route.even == check.even else None
    evens, many = jnp.asarray([route.even, check.even]), jnp.asarray([blocks, fewer])

    def one(row):
        legs, many, is_even = row
        return _pass(solver, split, start, legs, size, many, is_even if even is None else even)

    rows = jax.lax.map(one, (both, many, evens))
    return _unpacked(rows[0, :count], start), _unpacked(rows[1, : check.ends.shape[0]], start)


def _pass(
    solver: Any, split: AbstractStepper, start: Walker, legs, size: int, blocks, even
) -> Float[Array, "E numbers lanes"]:
    """What was passed at the end of each leg, in rows: of several arrays that a loop writes XLA may copy each as a whole for
    every row, and likewise of a single one that is long; so blocks of legs."""
    first = legs[1][0]
    known = None if even is False else split.table(solver, first)
    # Between steps of one size a past is kept; to make a new one takes longer than the steps of a leg.
    kept_open = split.has_past and even is True
    walker = start._replace(y=split.enter(solver, known, start.t, first, start.y)) if kept_open else start

    def leg(walker, row):
        begin, h, count, taken = row
        if isinstance(even, bool):
            table = known if even else split.table(solver, h)
        else:
            table = jax.lax.cond(even, lambda h: known, lambda h: split.table(solver, h), h)
        if not kept_open:
            walker = _moved(split, walker, split.enter(solver, table, begin, h, walker.y))
        walker = seen = _stepped(split, solver, table, begin, h, walker, taken)
        closed = split.leave(solver, table, walker.t if kept_open else begin + taken * h, h, walker.y)
        if kept_open:
            seen = walker._replace(y=closed)
        else:
            walker = seen = _moved(split, walker, closed)
        stopped = jnp.where((walker.stopped == 0) & (taken < count), Result.max_steps, walker.stopped)
        return walker._replace(stopped=stopped), _packed(seen._replace(stopped=stopped))

    legs = jax.tree.map(lambda x: x.reshape(-1, size, x.shape[-1]), legs)

    def block(k, carry):
        walker, saved = carry
        walker, rows = jax.lax.scan(leg, walker, jax.tree.map(lambda x: x[k], legs))
        return walker, saved.at[k].set(rows)

    shape = _packed(start).shape
    _, saved = jax.lax.fori_loop(0, blocks, block, (walker, jnp.zeros((legs[0].shape[0], size, *shape), start.t.dtype)))
    return saved.reshape(-1, *shape)


def _packed(walker: Walker) -> Float[Array, "numbers lanes"]:
    lanes = walker.t.shape[-1]
    return jnp.concatenate([x.astype(walker.t.dtype).reshape(-1, lanes) for x in jax.tree.leaves(walker)])


def _unpacked(rows: Float[Array, "T numbers lanes"], like: Walker) -> Walker:
    leaves, structure = jax.tree.flatten(like)
    ends = itertools.accumulate(x.size // x.shape[-1] for x in leaves)
    parts = jnp.split(rows, list(ends)[:-1], axis=1)
    shaped = [x.reshape(x.shape[0], *a.shape).astype(a.dtype) for x, a in zip(parts, leaves, strict=True)]
    return jax.tree.unflatten(structure, shaped)


def _stepped(split: AbstractStepper, solver: Any, table: Any, begin, h, walker: Walker, count) -> Walker:
    """The walker after `count` steps, its phase opened for them before and after."""

    def body(size: int, carry):
        k, walker = carry
        on = k < count if count.shape[-1] > 1 else True  # alike in all lanes, as the loop's own end
        path = [walker.y]
        here = _watched(split, path, walker, begin + k * h)
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
        y, going = path[-1], (stopped == 0) & on
        # A past goes on where the run stopped, into nothing: to hold it takes as long as the steps.
        held = on if split.has_past else going
        if held is not True and size == 1:
            y = jax.tree.map(lambda new, old: jnp.where(held, new, old), y, walker.y)
        turns = jnp.where(going, turns, walker.turns)
        stopped = jnp.where(on, stopped, walker.stopped)
        t, lowest = jnp.where(on, here.t, walker.t), jnp.where(on, here.lowest, walker.lowest)
        return k + size, Walker(y, turns, stopped, t, lowest)

    most, carry, size = jnp.max(count), (jnp.zeros((), count.dtype), walker), split.steps_at_once(solver)
    if size > 1:
        all_take = jnp.min(count)
        carry = jax.lax.while_loop(lambda carry: carry[0] + size <= all_take, functools.partial(body, size), carry)
    _, walker = jax.lax.while_loop(lambda carry: carry[0] < most, functools.partial(body, 1), carry)
    end = begin + count * h
    walker = _watched(split, [walker.y], walker, end)
    return walker._replace(t=jnp.where(walker.stopped == 0, end, walker.t))


def _moved(split: AbstractStepper, walker: Walker, y) -> Walker:
    """The walker at y, which may be on the other side of where turns are counted."""
    before, after = split.heading(walker.y), split.heading(y)
    return walker._replace(y=y, turns=walker.turns if after is None else walker.turns + passed(before, after))


def _strayed(before, after) -> Int[Array, " lanes"]:
    """Whether the rod turned too far in a step, or its straight way led through the pivot."""
    ahead = summed(before * after)
    sizes = summed(before * before) * summed(after * after)
    way = summed((before - after) ** 2)
    through = (ahead < 0) & (sizes - ahead * ahead < _NEAR * way)
    return jnp.where((ahead > 0) & (2 * ahead * ahead > sizes), 0, jnp.where(through, Result.collapsed, Result.coarse))


def _watched(split: AbstractStepper, phases: list, walker: Walker, t) -> Walker:
    """The walker with the reason why it stops at one of `phases`, if it does.  What it does after that means nothing."""
    lowest = split.lowest_strain(phases)
    why = jnp.where(lowest > _LEAST_STRAIN, 0, Result.collapsed)
    why = jnp.where(jnp.abs(lowest) < _LARGEST_STRAIN, why, Result.diverged)
    newest = phases[-1].q if split.has_past else phases[-1]
    total = sum(jnp.sum(x.reshape(-1, x.shape[-1]), axis=0) for x in jax.tree.leaves(newest))
    why = jnp.where(jnp.isfinite(total), why, Result.non_finite)
    first = walker.stopped == 0
    return walker._replace(
        stopped=jnp.where(first, why, walker.stopped),
        t=jnp.where(first, t, walker.t),
        lowest=jnp.where(first, jnp.minimum(lowest, walker.lowest), walker.lowest),
    )


# ---- backwards


_undoable = eqx.filter_custom_vjp(_forwards)


def _there(perturbed, moving, solver, turns, route, check):
    del perturbed
    walkers, checked = _forwards(moving, solver, turns, route, check)
    return (walkers, checked), walkers


def _and_back(walkers: Walker, gradient, perturbed, moving, solver, turns, route, check):
    """The gradients of `moving`."""
    del check
    split, y0, start, ends = moving
    other, stepped = split.undoable(solver)
    y_bars = jax.tree.map(lambda x, bar: jnp.zeros_like(x) if bar is None else bar, walkers.y, gradient[0].y)
    if stepped is not split:  # what cannot be undone is run again by what can
        reached = walkers.stopped == 0
        walkers, _ = _forwards((stepped, y0, start, ends), other, turns, route, None)
        lost = jnp.where(reached & (walkers.stopped != 0), jnp.nan, 0.0)  # what that does not reach has no derivative
        y_bars = jax.tree.map(lambda bar: bar + lost.reshape(lost.shape[0], *[1] * (bar.ndim - 2), -1), y_bars)
    asked, known = eqx.partition(split, jax.tree.map(bool, perturbed[0]))
    by_times = any(jax.tree.leaves(perturbed[2:]))
    arrays, rest = eqx.partition((asked, known, route), eqx.is_array)

    def back(arrays, start, ends, walkers, y_bars):
        asked, known, route = eqx.combine(arrays, rest)
        route = eqx.tree_at(lambda r: (r.start, r.ends), route, (start, ends))
        return _undone(solver, asked, known, route, by_times, walkers, y_bars)

    found = over_lanes(back)(*spread((arrays, start, ends)), walkers, y_bars)
    split_bar, y_bar, times_bar = reversible(alone(found), 0, ONCE)
    return jax.tree.map(lambda _, x: x, asked, split_bar), y_bar, *((None, None) if times_bar is None else times_bar)


def _undone(solver: Any, asked, known, route: Route, by_times: bool, walkers: Walker, y_bars: PhasePoint):
    """Laned: the gradients of the split as far as `asked`, of y0, and of the times if asked; each stage is undone, then its
    derivative is taken where it began."""
    lanes = lanes_of(eqx.filter((walkers, y_bars, asked, known, route), eqx.is_array))
    asked, walkers, y_bars = widened((asked, walkers, y_bars), lanes)
    dtype = route.ends.dtype

    def stepped(asked) -> AbstractSplitting:
        return eqx.combine(asked, known).undoable(solver)[1]

    scheme, split = eqx.combine(asked, known).undoable(solver)

    def leg(carry, row):
        walker, bar, begin, h, count = row
        y_bar, asked_bar = jax.tree.map(jnp.add, carry[0], bar), carry[1]
        table = split.table(scheme, h)

        def pulled(function, sums, t, k, y, y_bar):
            """`sums` and `y_bar` before `function` of (split, t, h, y), at the step k that begins at t."""

            def of_moved(asked, moment, y):
                return function(stepped(asked), *((t, h) if moment is None else moment), y)

            _, pull = jax.vjp(of_moved, asked, widened((t, h), lanes) if by_times else None, y)
            asked_bar, moment_bar, y_bar = pull(y_bar)
            if by_times:
                t_bar, h_bar = moment_bar
                moment_bar = (t_bar, h_bar + k * t_bar)
            return jax.tree.map(jnp.add, sums, (asked_bar, moment_bar)), y_bar

        def open_(split: AbstractSplitting, t, h, y):
            return split.normalized(split.enter(scheme, table, t, h, y))

        def close(split: AbstractSplitting, t, h, y):
            return split.leave(scheme, table, t, h, y)

        def step(carry):
            k, y, y_bar, sums = carry
            k = k - 1
            t = begin + k * h

            def visit(carry, stage, row):
                y, y_bar, sums = carry
                y = split.inverse_stage(stage, row, t, h, y)

                def ahead(split: AbstractSplitting, t, h, y):
                    return split.normalized(split.stage(stage, row, t, h, y))

                sums, y_bar = pulled(ahead, sums, t, k, y, y_bar)
                return y, y_bar, sums

            before, on = (y, y_bar, sums), k < count if count.shape[-1] > 1 else True
            after = split.scan_stages(scheme, table, visit, before, backwards=True)
            return k, *jax.tree.map(lambda new, old: jnp.where(on, new, old), after, before)

        sums = (asked_bar, (jnp.zeros(lanes, dtype),) * 2 if by_times else None)
        before = y_bar, sums
        y = open_(split, begin, h, walker.y)
        sums, y_bar = pulled(close, sums, begin, 0, y, y_bar)
        most = jnp.max(count)
        _, y, y_bar, sums = jax.lax.while_loop(lambda carry: carry[0] > 0, step, (most, y, y_bar, sums))
        sums, y_bar = pulled(open_, sums, begin, 0, close(split, begin, h, y), y_bar)
        # Where a run stopped nothing is undone, and nothing was asked of it.
        ended = (walker.stopped == 0) | (walker.stopped == Result.max_steps)
        y_bar, (asked_bar, moment_bar) = jax.tree.map(
            lambda new, old: jnp.where(ended, new, old), (y_bar, sums), before
        )
        return (y_bar, asked_bar), moment_bar

    none = jax.tree.map(lambda x: jnp.zeros_like(x[0]), y_bars)
    rows = (walkers, y_bars, *route.times(), route.taken)
    (y_bar, asked_bar), moments_bar = jax.lax.scan(leg, (none, jax.tree.map(jnp.zeros_like, asked)), rows, reverse=True)
    if not by_times:
        return asked_bar, y_bar, None

    def times(start, ends):
        return eqx.tree_at(lambda r: (r.start, r.ends), route, (start, ends)).times()

    _, pull = jax.vjp(times, *widened((route.start, route.ends), lanes))
    return asked_bar, y_bar, pull(moments_bar)


_undoable.def_fwd(_there)
_undoable.def_bwd(_and_back)
