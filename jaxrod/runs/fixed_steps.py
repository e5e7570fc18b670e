"""One compiled run by equal steps of a symplectic solver, and how many of them an accuracy takes."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..core.linear_algebra import eigvalsh
from ..core.result import Result
from ..integrators.fixed_step import COARSE, COLLAPSED, DIVERGED, NON_FINITE, Route, march
from ..integrators.multistep import AbstractMultistep
from ..integrators.reversal import forward_refused
from ..integrators.runge_kutta import Unrolled
from ..integrators.splitting import AbstractStepped
from ..integrators.symplectic import ABA864, AbstractSymplectic
from ..mechanics.energy import gravity_pivoted, kinetic_director
from ..mechanics.equations import eigenvalues
from ..mechanics.splittings.multistep import Remembered
from ..mechanics.splittings.uniform_strain import Flat
from ..mechanics.splittings.unsplit import Whole
from ..mechanics.system import System
from ..motions.preview import INSTANTS, Preview, preview
from ..motions.state import State
from ..motions.stops import Stops
from .invariants import energy_change, is_closed, over, with_start
from .solution import Solution

LEAST_TOLERANCE = {"float64": 1e-12, "float32": 1e-5}  # that a type reaches
_FINEST = 0.3  # phase of the fastest motion in a step of `BlanesMoan6` at tolerance 1e-8, and that of `ABA864` at ...
_FINEST_SMALL_KICKS = 0.11  # ... kicks as strong as the springs; both measured: docs/performance.md
_LONGEST_PHASE = 3.0  # rad in a step of `BlanesMoan6`, which is stable up to 3.14
_LONGEST_TURN = 0.4  # rad in a step
_PRESSED = -2 / 3  # strain below which the default's steps are not trusted: benchmarks/random_extremes.py
_HARD = 0.05  # strain ahead above which steps of more than one strain shape are looked at twice
_LINGERING = 0.2  # energy, from that of standing upside down, within which a run is looked at so too
_HOPELESS = {"float64": 1e3, "float32": 2.0}  # strain ahead above which the default's steps are not trusted
_FEWER = 0.618  # share of the steps, taken again: half of them would be in resonance with the same mode
_UNRESOLVED = {"float64": 1.5, "float32": 1.0}  # difference from fewer steps, in tolerances, that is too large
_AT_FIRST = 0.5  # share of it that is too large in the first part of a run
_SEEN = 8  # save times at which that is looked at
_CLEAR = 0.3  # sine of half a mode's phase in a step, below which the kicks of many steps add up: 0 in resonance
_SHORTER = 1 - np.arange(8) / 16  # share of a step, tried until it is clear
_EACH_RADIAN = {"float64": 0.0, "float32": 6e-7}  # rounding, of the length, for each radian that the rod turned
_MOST = 2**30 - 1  # steps that are counted
_OPEN_ENERGY = 0.3  # energy lost, in tolerances, above which steps were too long


def step_size(
    system: System, start: State, solver: AbstractSymplectic, tolerance, t0, t1, looked: Preview | None
) -> Float[Array, ""]:
    """Step in s with which the tip's relative error after 1,000 axial periods is about `tolerance`."""
    turning = _turning(system, start, t0, t1, looked) + 1 / jax.lax.stop_gradient(t1 - t0) ** 2
    finer = (tolerance / 1e-8) ** (1 / 6)
    axial = turning if system.basis.n == 0 else eigenvalues(system.body)[0]
    # Large strains make the kicks large too.  By how much is measured: benchmarks/random_extremes.py.
    strain = _strain_ahead(system, start, turning)
    if isinstance(solver, ABA864) and system.basis.n:
        strain = jnp.minimum(strain, 1.0)
        finer_there = jnp.where(finer > 1, finer ** (1 - strain), finer)  # a loose tolerance gains less there
        phase = jnp.minimum(_FINEST_SMALL_KICKS * finer_there * (turning / axial) ** (-1 / 6), 1.0) / (1 + 8 * strain)
        step = phase / jnp.sqrt(axial + turning)
    else:
        rate = 2 * turning if system.basis.n == 0 else turning + axial
        step = jnp.minimum(_FINEST * finer, _LONGEST_PHASE) / (1 + 0.7 * jnp.minimum(strain, 3.0)) / jnp.sqrt(rate)
    return jnp.minimum(step, _LONGEST_TURN * jnp.minimum(finer, 1.0) / jnp.sqrt(turning))


def _turning(system: System, start: State, t0, t1, looked: Preview | None) -> Float[Array, ""]:
    """Square of the rate in rad/s at which the rod turns or swings, as far as its start and its loads show."""
    square = start.direction_rate @ start.direction_rate
    if looked is not None:
        square = square + 2 * looked.gained * jnp.sqrt(square) + looked.gained**2
    if system.motion.prescribed:
        square = jnp.max(jax.vmap(system.motion.turning)(jnp.linspace(t0, t1, INSTANTS))[1] ** 2)
    if system.gravity is not None and not system.motion.flies:
        weight = jnp.sqrt(jnp.sum(system.gravity**2))
        square = square + 4 * jnp.abs(weight * system.body.first_moments[0]) / system.body.mass_matrix[0, 0]
    return jax.lax.stop_gradient(square)


def _strain_ahead(system: System, start: State, turning) -> Float[Array, ""]:
    """How large the strain gets, as far as the start shows."""
    if system.basis.n == 0:
        return jnp.zeros_like(turning)
    axial = eigenvalues(system.body)[0]
    strain = jnp.sum(jnp.abs(start.amplitudes)) + jnp.sum(jnp.abs(start.amplitude_rates)) / jnp.sqrt(axial)
    return jax.lax.stop_gradient(strain + turning / axial)


@forward_refused()
@eqx.filter_jit
def step_through(
    system, start, t0, ts, solver, n_steps, tolerance, even, end_only, max_steps, backwards, knots
) -> Solution:  # fmt: skip
    """A run that saves at `ts` (T,), or where it ends: by `n_steps` equal steps in all, or by as many as `tolerance` takes.

    A step ends at each of `knots` too (None: there are none), and where functions of time are seen to change.
    """
    given, given_ts, given_start = system, ts, start
    # What is invalid is run with ones for all its numbers: its own would keep its neighbours waiting.  Times, scene and
    # start each by itself, so that what is common to all lanes stays so under `vmap`.
    valid_times = jnp.all(jnp.diff(ts) > 0) & (ts[0] >= t0) & (ts[-1] > t0)
    ts = jnp.where(valid_times, ts, t0 + 1 + jnp.arange(ts.size, dtype=ts.dtype))
    sound = system.sound()
    system = jax.tree.map(lambda x: jnp.where(sound, x, jnp.ones_like(x)), system)
    valid = system.valid(start)
    start = jax.tree.map(lambda x: jnp.where(valid, x, jnp.ones_like(x)), start)
    looked = preview(system, start, t0, ts[-1], knots)
    stops = Stops.of(t0, ts, knots, looked if n_steps is None else None)
    even = even and stops.inner is None
    ends = stops.ends
    counts = _counts(system, start, t0, ends, solver, n_steps, tolerance, even, looked)
    split = _stepped(system, start, t0, solver)
    longest = jax.lax.stop_gradient(jnp.asarray(split.longest_step(solver, ends), t0.dtype))
    stable = jnp.max(jnp.diff(ends, prepend=t0) / jnp.maximum(counts, 1)) <= longest * (1 + 1e-6)
    taken = jnp.where(stable, jnp.clip(max_steps - (_summed(counts) - counts), 0, counts), 0)
    enough = taken == counts
    valid = valid & sound & valid_times

    saved = march(solver, split, split.encode(start), start.turns, Route(t0, ends, counts, taken, even), backwards)
    last, saved = jax.tree.map(lambda x: x[-1], saved), stops.at_saves(saved)
    states = jax.vmap(split.decode)(ts, saved.y, saved.turns)
    reached = valid & ((end_only and not split.has_past) | ((saved.stopped == 0) & stops.at_saves(enough)))
    code = Result.where(last.stopped == COLLAPSED, Result.collapsed, Result.ok)
    for stopped, why in ((DIVERGED, Result.diverged), (COARSE, Result.coarse), (NON_FINITE, Result.non_finite)):
        code = Result.where(last.stopped == stopped, why, code)
    code = Result.where((code == Result.ok) & ~jnp.all(enough), Result.max_steps, code)
    # The default's own steps are too long only where there are more of them than can be counted.
    code = Result.where(stable, code, Result.max_steps if n_steps is None else Result.coarse)
    lost = _energy_lost(system, start, states, saved.stopped == 0)
    rounding = 10 * jnp.finfo(t0.dtype).eps * jnp.sqrt(jnp.sum(taken).astype(t0.dtype))
    open_energy = _OPEN_ENERGY * tolerance + rounding if n_steps is None else 0.1
    code = Result.where((code == Result.ok) & (lost > open_energy), Result.coarse, code)
    if n_steps is None:  # steps counted from the start do not see how fast the rod turns when pressed together later
        code = Result.where((code == Result.ok) & (last.lowest < _PRESSED), Result.coarse, code)
    if n_steps is None:
        trusted = _trusted(system, start, solver, split, t0, ts, tolerance, stops, taken, states, looked)
        code = Result.where((code == Result.ok) & ~trusted, Result.coarse, code)
    elif looked is not None:
        code = Result.where((code == Result.ok) & looked.hides_in((ts[-1] - t0) / n_steps), Result.coarse, code)
    # By a product: what was not reached has no derivative, and zero would be taken for one.
    known = jnp.where(reached, 1.0, jnp.nan).astype(t0.dtype)
    states = jax.tree.map(lambda x: x * known.reshape((-1,) + (1,) * (x.ndim - 1)), states)
    steps = jnp.sum(taken)
    return Solution(
        ts=jnp.where(reached, jnp.where(last.stopped == 0, given_ts, last.t), jnp.nan) if end_only else given_ts,
        states=states,
        result=Result.where(valid, code, Result.invalid),
        stats={
            "num_steps": steps,
            "num_accepted_steps": steps,
            "num_rejected_steps": jnp.zeros_like(steps),
            "t_end": last.t,
            "longest_step": jnp.minimum(longest, jnp.finfo(longest.dtype).max),  # of a method without one
            "lowest_strain": last.lowest,
            "step": (last.t - t0) / jnp.maximum(steps, 1),
            **({} if looked is None else {"unseen": looked.unseen}),
        },
        system=given,
        start=given_start,
        method=f"{type(solver).__name__}, {type(split).__name__}",
    )


def _trusted(
    system: System,
    start: State,
    solver,
    split,
    t0,
    ts,
    tolerance,
    stops: Stops,
    taken,
    states: State,
    previewed: Preview | None,
) -> Bool[Array, ""]:
    """Whether steps that were counted from the start were short enough for what came.

    Fewer are taken too where no energy tells: where loads do not keep it, where large strains hide the error from it, where
    the rod may linger upside down, and in float32, whose rounding it does not show.
    """
    name, closed = t0.dtype.name, is_closed(system)
    ahead = _strain_ahead(system, start, _turning(system, start, t0, ts[-1], previewed))
    trusted = system.motion.prescribed | (ahead <= _HOPELESS[name])
    if name == "float32" and system.basis.n > 1:
        trusted = trusted & (_condition(system) * jnp.finfo(t0.dtype).eps <= tolerance)
    always = not closed or name == "float32"
    if not always and system.basis.n < 2:
        return trusted
    # Where little is to be feared, in the first part of the run, of which the rest is thought to be off in proportion.
    parts = min(_SEEN, ts.size)
    whole = jnp.asarray(always) | (ahead > _HARD) | _may_linger(system, start)
    looked = whole | ((jnp.arange(parts) == 0) & (parts > 1))
    off = _off_by_fewer(system, solver, split, start, t0, ts, stops, taken, states, looked)
    turned = jnp.mean(jnp.linalg.norm(states.direction_rate, axis=-1)) * (ts[-1] - t0)
    bound = _UNRESOLVED[name] * (tolerance + _EACH_RADIAN[name] * turned) * jnp.where(whole, 1.0, _AT_FIRST)
    if stops.inner is not None:  # a leg of one step is held against two, which are less apart than fewer and all
        bound = jnp.where(jnp.any(taken == 1), bound / 2, bound)
    return trusted & jnp.all((off <= bound) | ~looked)


def _may_linger(system: System, start: State) -> Bool[Array, ""]:
    """Whether the rod may come to a stop near its inverted equilibrium, where what it is off by grows exponentially."""
    if system.gravity is None or system.motion.flies:
        return jnp.asarray(False)
    body, straight = system.body, jnp.zeros_like(start.amplitudes)
    energy = kinetic_director(body, straight, straight, start.direction_rate)
    energy = energy + gravity_pivoted(body, system.gravity, straight, start.direction)
    top = jnp.sqrt(jnp.sum(system.gravity**2)) * jnp.abs(body.moment(straight))
    return jax.lax.stop_gradient(jnp.abs(energy - top) < _LINGERING * top)


def _condition(system: System) -> Float[Array, ""]:
    """By how much rounding grows in the mass matrix of the strain."""
    mass = jax.lax.stop_gradient(system.body.strain_mass)
    size = jnp.sqrt(jnp.diagonal(mass))
    spread = eigvalsh(mass / (size[:, None] * size[None, :]))
    return spread[-1] / jnp.maximum(spread[0], jnp.finfo(mass.dtype).eps)


def _off_by_fewer(
    system: System, solver, split, start: State, t0, ts, stops: Stops, steps, states: State, looked: Bool[Array, " K"]
) -> Float[Array, " K"]:
    """By how much the tip is elsewhere with fewer than `steps`, over the furthest it was out, at least the length.

    At K of the save times, the first ones that are `looked` at: at the end alone two errors that oscillate may meet.
    """
    seen = np.unique(np.linspace(0, ts.size - 1, looked.size + 1)[1:].astype(int))
    halts = Stops.merged(t0, ts[seen], stops.inner)
    reached = seen if stops.inner is None else stops.last_until(halts.ends)
    legs = jnp.diff(_summed(steps)[reached], prepend=0)
    fewer = jnp.where(legs == 1, 2, jnp.round(_FEWER * legs).astype(legs.dtype))
    fewer = fewer * looked if stops.inner is None else fewer  # loads are looked at to the end
    route = Route(t0, halts.ends, fewer, fewer, halts.ends.size == 1)
    other = halts.at_saves(march(solver, split, split.encode(start), start.turns, route, False))

    def tip(state: State) -> Float[Array, " D"]:  # in flight from the centre of mass
        return system.body.reach(state.amplitudes) * state.direction

    here = jax.vmap(tip)(states)
    there = jax.vmap(tip)(jax.vmap(split.decode)(ts[seen], other.y, other.turns))
    size = jnp.maximum(jnp.max(jnp.linalg.norm(here, axis=-1)), system.rod.length)
    return jax.lax.stop_gradient(jnp.linalg.norm(here[seen] - there, axis=-1) / size)


def _stepped(system: System, start: State, t0, solver: Any) -> AbstractStepped:
    """The scene as the solver steps it."""
    if isinstance(solver, Unrolled):
        return Whole(system)
    if isinstance(solver, AbstractMultistep):
        split = system.split(start, t0)
        assert isinstance(split, Flat)
        return Remembered(split)
    return system.split(start, t0, solver.small_kicks)


def _counts(system, start, t0, ts, solver, n_steps, tolerance, even, looked: Preview | None) -> Int[Array, " T"]:
    """Steps to each of the times `ts`."""
    legs = jnp.diff(ts, prepend=t0)
    least = jnp.where(legs > 0, 1.0, 0.0)
    if looked is not None and n_steps is None:
        finer = jnp.minimum((tolerance / 1e-8) ** (1 / 6), 1.0)
        least = jnp.maximum(least, jnp.ceil(jax.lax.stop_gradient(looked.steps(ts) / finer)))

    def counts(size):
        each = jnp.maximum(jnp.ceil(jax.lax.stop_gradient(legs / size) - 1e-6), least)
        if even:  # one size for all
            each = jnp.where(legs > 0, jnp.max(each), 0.0)
        return jnp.clip(jnp.nan_to_num(each, nan=_MOST), 0, _MOST)

    if n_steps is not None:
        return counts((ts[-1] - t0) / n_steps).astype(jnp.int32)
    size = step_size(system, start, solver, tolerance, t0, ts[-1], looked)
    if system.basis.n < 2:
        return counts(size).astype(jnp.int32)
    tried = jax.vmap(counts)(_SHORTER * size)
    sizes = (ts[-1] - t0) / jnp.sum(tried, axis=1)
    phases = jnp.outer(sizes, jnp.sqrt(eigenvalues(system.body)))
    clear = jnp.min(jnp.where(phases > math.pi, jnp.abs(jnp.sin(phases / 2)), 1.0), axis=1)
    return tried[jnp.argmax(jnp.minimum(clear, _CLEAR))].astype(jnp.int32)  # the first, where several are


def _summed(counts: Int[Array, " T"]) -> Int[Array, " T"]:
    """Steps to each save time in all, or `_MOST`: two such numbers still have a sum."""
    # In floats, which do not overflow, exact for 2^24 steps; an associative scan takes XLA minutes to compile.
    return jnp.minimum(jnp.cumsum(counts.astype(float)), _MOST).astype(counts.dtype)


def _energy_lost(system: System, start: State, states: State, reached) -> Float[Array, ""]:
    """Largest change of the energy at a save time over what moves in it; zero where it need not keep its energy."""
    if not is_closed(system):
        return jnp.zeros_like(start.turns)
    change, size = energy_change(system, jax.lax.stop_gradient(with_start(start, states)))
    change = jnp.max(jnp.where(reached, jnp.abs(change[1:]), 0.0))
    return jax.lax.stop_gradient(over(change, size))
