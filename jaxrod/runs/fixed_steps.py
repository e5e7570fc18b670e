"""One compiled run by equal steps of a symplectic, multistep or Runge-Kutta solver, and how many of them an accuracy takes."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..core import progress, tracing
from ..core.result import Result
from ..integrators.fixed_step import Route, Walker, march
from ..integrators.multistep import AbstractMultistep
from ..integrators.reversal import as_far_as, forward_refused
from ..integrators.runge_kutta import Unrolled
from ..integrators.splitting import AbstractStepper
from ..integrators.symplectic import ABA864, AbstractSymplectic
from ..mechanics.equations import DiscreteSystem
from ..mechanics.splittings.multistep import MultistepStepper
from ..mechanics.splittings.uniform_strain import UniformStrainSplitting
from ..mechanics.splittings.unsplit import UnsplitStepper
from ..mechanics.system import System
from ..motions.preview import Preview
from ..motions.state import State
from ..motions.stops import Stops
from .acceptance import MOST_STEPS, Comparison, energy_lost, foreseen, steps_so_far
from .scales import Scales
from .solution import Solution
from .step_policy import StepPolicy

LEAST_TOLERANCE = {"float64": 1e-12, "float32": 1e-5}  # that a type reaches
_SHORTER = 1 - np.arange(8) / 16  # share of a step, tried until it is clear of resonance


def step_size(scales: Scales, solver: AbstractSymplectic, tolerance, policy: StepPolicy) -> Float[Array, ""]:
    """Step in s with which the tip's relative error after 1,000 axial periods is about `tolerance`.

    By the rates of turning and of the slowest axial mode; the faster modes are exact, or there are none.
    """
    turning, strain = scales.turning, scales.strain
    if scales.axial.size:  # in a short run no less than would be reached in it
        strain = strain + (scales.least / scales.axial[0]) ** 2
    finer = (tolerance / 1e-8) ** (1 / 6)
    # Large strains make the kicks large too.
    if isinstance(solver, ABA864) and scales.axial.size:
        axial, strain = scales.axial[0], jnp.minimum(strain, 1.0)
        finer_there = jnp.where(finer > 1, finer ** (1 - strain), finer)  # a loose tolerance gains less there
        phase = jnp.minimum(policy.finest_small_kicks * finer_there * (turning / axial) ** (-1 / 3), 1.0)
        step = phase / (1 + policy.stretched_small_kicks * strain) / jnp.sqrt(axial**2 + turning**2)
    else:
        rate = jnp.sqrt(turning**2 + scales.axial[0] ** 2) if scales.axial.size else math.sqrt(2.0) * turning
        phase = jnp.minimum(policy.finest * finer, policy.longest_phase)
        step = phase / (1 + policy.stretched * jnp.minimum(strain, 4.0)) / rate
    return jnp.minimum(step, policy.longest_turn * jnp.minimum(finer, 1.0) / turning)


@forward_refused()
@tracing.program
def step_through(
    system: System,
    start: State,
    t0: Float[Array, ""],
    ts: Float[Array, " T"],
    solver: Any,
    n_steps: Float[Array, ""] | None,
    tolerance: Float[Array, ""],
    even: bool,
    end_only: bool,
    max_steps: int,
    backwards: bool,
    knots: Float[Array, " K"] | None,
    policy: StepPolicy,
) -> Solution:
    """A run that saves at `ts`, or where it ends: by `n_steps` equal steps in all, or by as many as `tolerance` takes.

    A step ends at each of `knots` too (None: there are none), and where functions of time are seen to change.
    """
    progress.compiling()
    given, given_ts, given_start = system, ts, start
    system, scene, start, ts, valid = _runnable(system, start, t0, ts)
    looked = Preview.of(scene, start, t0, ts[-1], knots)
    scales = Scales.of(scene, start, t0, ts[-1], looked)
    stops = Stops.of(t0, ts, knots, looked if n_steps is None else None)
    even = even and stops.inner is None
    ends = stops.ends
    size = (ts[-1] - t0) / n_steps if n_steps is not None else step_size(scales, solver, tolerance, policy)
    counts = _counts(scales, t0, ends, size, None if n_steps is not None else tolerance, even, looked, policy)
    split = _stepped(system, scene, start, t0, solver)
    longest = jax.lax.stop_gradient(jnp.asarray(split.longest_step(solver, scales.spin), t0.dtype))
    stable = jnp.max(jnp.diff(ends, prepend=t0) / jnp.maximum(counts, 1)) <= longest * (1 + 1e-6)
    taken = jnp.where(stable, jnp.clip(max_steps - (steps_so_far(counts) - counts), 0, counts), 0)
    enough = taken == counts

    comparison = None if n_steps is not None else Comparison.of(scene, start, scales, t0, ts, stops, taken, policy)
    route, check = Route(t0, ends, counts, taken, even), None if comparison is None else comparison.route
    saved, others = march(solver, split, split.encode(start), start.turns, route, check, backwards)
    last, saved = jax.tree.map(lambda x: x[-1], saved), stops.at_saves(saved)
    states = jax.vmap(split.decode)(ts, saved.y, saved.turns)
    reached = valid & ((end_only and not split.has_past) | ((saved.stopped == 0) & stops.at_saves(enough)))
    lost = energy_lost(scene, start, states, saved.stopped == 0)
    rounding = 10 * jnp.finfo(t0.dtype).eps * jnp.sqrt(jnp.sum(taken).astype(t0.dtype))
    if n_steps is None:
        coarse = lost > policy.open_energy * tolerance + rounding
        # Steps counted from the start do not see how fast the rod turns when pressed together later.
        coarse = coarse | (last.lowest < policy.pressed)
        coarse = coarse | ~foreseen(scene, scales, tolerance, policy)
        if comparison is not None and others is not None:
            off = comparison.off(scene, split, ts, states, others)
            turned = jnp.mean(jnp.linalg.norm(states.direction_rate, axis=-1)) * (ts[-1] - t0)
            coarse = coarse | ~comparison.passed(off, tolerance, turned, jnp.any(taken == 1), policy)
    else:
        coarse = lost > 0.1
        coarse = coarse if looked is None else coarse | looked.hides_in(size)
    code = Result.first(
        (~valid, Result.invalid),
        # The default's own steps are too long only where there are more of them than can be counted.
        (~stable, Result.max_steps if n_steps is None else Result.coarse),
        (last.stopped != Result.ok, last.stopped),
        (coarse, Result.coarse),
    )
    followed = (saved.stopped == Result.ok) | (saved.stopped == Result.max_steps)
    states = as_far_as(reached, followed, states, (given, given_start, t0, given_ts))
    return Solution(
        ts=jnp.where(reached, jnp.where(last.stopped == 0, given_ts, last.t), jnp.nan) if end_only else given_ts,
        states=states,
        result=code,
        stats=_stats(t0, last, jnp.sum(taken), longest, looked),
        system=given,
        start=given_start,
        method=f"{type(solver).__name__}, {type(split).__name__}",
    )


def _stats(
    t0, last: Walker, steps: Int[Array, ""], longest: Float[Array, ""], looked: Preview | None
) -> dict[str, Any]:
    return {
        "num_steps": steps,
        "num_accepted_steps": steps,
        "num_rejected_steps": jnp.zeros_like(steps),
        "t_end": last.t,
        "longest_step": jnp.minimum(longest, jnp.finfo(longest.dtype).max),  # of a method without one
        "lowest_strain": last.lowest,
        "step": (last.t - t0) / jnp.maximum(steps, 1),
        **({} if looked is None else {"unseen": looked.unseen}),
    }


def _runnable(system: System, start: State, t0, ts) -> tuple[System, DiscreteSystem, State, Array, Bool[Array, ""]]:
    """Scene, start and save times, with others in place of what is invalid, and whether all of it is valid.

    Its own numbers would keep its neighbours waiting.  Times, scene and start each by itself, so that what is common to all
    lanes stays so under `vmap`.
    """
    valid_times = jnp.all(jnp.diff(ts) > 0) & (ts[0] >= t0) & (ts[-1] > t0)
    ts = jnp.where(valid_times, ts, t0 + 1 + jnp.arange(ts.size, dtype=ts.dtype))
    system, scene, sound = system.or_idle()
    valid = scene.valid(start)
    start = jax.tree.map(lambda x: jnp.where(valid, x, jnp.ones_like(x)), start)
    return system, scene, start, ts, valid & sound & valid_times


def _stepped(system: System, scene: DiscreteSystem, start: State, t0, solver: Any) -> AbstractStepper:
    """The scene as the solver steps it."""
    if isinstance(solver, Unrolled):
        return UnsplitStepper(system, scene)
    if isinstance(solver, AbstractMultistep):
        split = system.split(start, t0, scene=scene)
        assert isinstance(split, UniformStrainSplitting)
        return MultistepStepper(split)
    return system.split(start, t0, solver.small_kicks, scene)


def _counts(scales: Scales, t0, ends, size, tolerance, even: bool, looked: Preview | None, policy) -> Int[Array, " E"]:
    """Steps of about `size` to each of the times `ends`; more where loads ask for them, but of steps that were given
    (`tolerance` None)."""
    legs = jnp.diff(ends, prepend=t0)
    least = jnp.where(legs > 0, 1.0, 0.0)
    if looked is not None and tolerance is not None:
        finer = jnp.minimum((tolerance / 1e-8) ** (1 / 6), 1.0)
        least = jnp.maximum(least, jnp.ceil(jax.lax.stop_gradient(looked.steps(ends) / finer)))

    def counts(size):
        each = jnp.maximum(jnp.ceil(jax.lax.stop_gradient(legs / size) - 1e-6), least)
        if even:  # one size for all
            each = jnp.where(legs > 0, jnp.max(each), 0.0)
        return jnp.clip(jnp.nan_to_num(each, nan=MOST_STEPS), 0, MOST_STEPS)

    if tolerance is None or scales.axial.size < 2:
        return counts(size).astype(jnp.int32)
    tried = jax.vmap(counts)(_SHORTER * size)
    sizes = (ends[-1] - t0) / jnp.sum(tried, axis=1)
    phases = jnp.outer(sizes, scales.axial)
    clear = jnp.min(jnp.where(phases > math.pi, jnp.abs(jnp.sin(phases / 2)), 1.0), axis=1)
    return tried[jnp.argmax(jnp.minimum(clear, policy.clear))].astype(jnp.int32)  # the first, where several are
