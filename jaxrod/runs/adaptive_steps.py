"""One compiled run: a scene in coordinates, stepped by Diffrax, ended by events, decoded into states."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, PyTree

from .. import continuum
from ..core import progress, tracing
from ..core.linear_algebra import mappable
from ..core.result import Result
from ..integrators.compensation import Tracked, Tracking
from ..integrators.event_time import EventTime
from ..integrators.reversal import ONCE, as_far_as, forward_refused, reversible
from ..integrators.symplectic import AbstractSymplectic, SplitTerm
from ..mechanics.chart import AbstractChart
from ..mechanics.equations import Condensed, DiscreteSystem, Moving, critical_square
from ..mechanics.lagrangian import Lagrangian, Phase
from ..mechanics.system import System
from ..motions.preview import Preview
from ..motions.state import State
from ..motions.stops import Stops, since
from ..rods.rod import Rod
from ..shapes.projection import Projection
from .defaults import default_chart
from .scales import Scales
from .solution import Solution

_COLLAPSED = -1 + 1e-6
_DIVERGED = 1e6


@forward_refused()
@tracing.program
def integrate(
    system: System | Lagrangian,
    start: Any,  # State | Phase
    chart: AbstractChart | None,
    t0: Float[Array, ""],
    t1: Float[Array, ""],
    ts: Float[Array, " T"] | None,
    atol: Float[Array, ""],
    solver: Any,
    controller: diffrax.AbstractStepSizeController | None,
    dt0: Any,
    n_steps: int | None,
    saveat: diffrax.SaveAt | None,
    event: diffrax.Event | None,
    adjoint: diffrax.AbstractAdjoint,
    progress_meter: diffrax.AbstractProgressMeter,
    max_steps: int,
    longest: Float[Array, ""] | None,
    knots: Float[Array, " K"] | None,
) -> Solution:
    """A run by Diffrax in the coordinates of `chart`; with None a symplectic solver's, or a `Lagrangian`'s, own.

    It saves at `ts` (None: at t1, or by `saveat`).  Steps are given by `controller`, dt0 or n_steps; else they adapt to the
    local error `atol`, none longer than `longest`, and end at `knots`.
    """
    progress.compiling()
    if isinstance(adjoint, diffrax.RecursiveCheckpointAdjoint):
        system, start, t0, t1, ts = reversible((system, start, t0, t1, ts), 1, ONCE)
    given, given_start, given_ts, valid = system, start, ts, t1 > t0
    if ts is not None:
        valid = valid & jnp.all(jnp.diff(ts) > 0) & (ts[0] >= t0)
        ts = jnp.where(valid, ts, t0 + 1 + jnp.arange(ts.size, dtype=ts.dtype))
    t1 = jnp.where(valid, t1, t0 + 1 if ts is None else ts[-1])
    scene: Any = system
    scales = None
    if isinstance(system, System):
        # What is invalid, scene or start, is run with other numbers: its own would keep its neighbours waiting for NaN.
        system, scene, sound = system.or_idle()
        valid = valid & sound & scene.valid(start)
        start = jax.tree.map(lambda x: jnp.where(valid, x, jnp.ones_like(x)), start)
    looked = Preview.of(scene, start, t0, t1, knots)
    if isinstance(scene, DiscreteSystem):
        scales = Scales.of(scene, start, t0, t1, looked)
    coordinates = _Coordinates.of(system, scene, start, t0, chart, solver)
    margin = _Margin.of(system, scene) if isinstance(system, System) and system.basis.n else None
    adapt = (ts is not None, t1[None] if ts is None else ts, knots, looked, atol, longest)
    raw: Any = diffrax.diffeqsolve(
        coordinates.terms,
        Tracking(mappable(solver)),
        t0,
        t1,
        dt0,
        coordinates.y0,
        saveat=_saveat(saveat, ts, coordinates),
        stepsize_controller=_steps(scene, scales, coordinates.y0, t0, t1, controller, dt0, n_steps, *adapt),
        adjoint=adjoint,
        event=_events(event and _begun(event, system, scene, start, chart, t0, t1), coordinates, margin),
        max_steps=max_steps,
        throw=False,
        progress_meter=progress_meter,
    )
    saved = jnp.isfinite(raw.ts["run"]) & valid
    states = raw.ys["run"] if saveat is not None else coordinates.unpacked(t0, raw.ys["run"])
    states = as_far_as(saved, saved, states, (given, given_start, t0, t1, ts))
    last, t_end = jax.tree.map(lambda y: y[-1], (raw.ys["end"], raw.ts["end"]))
    stats = _stats(raw, t_end - t0, looked) | {"t_end": t_end}
    room = jnp.ones(3) if margin is None else margin(coordinates.decode(t_end, last))
    code = _result(raw, _finite(last), room, valid, event is not None)
    if scales is not None and _are_given(controller, dt0, n_steps):
        most = _longest_step(scales, solver, coordinates.split)
        code = Result.where((code == Result.ok) & (stats["step"] > most * (1 + 1e-6)), Result.coarse, code)
    return Solution(
        ts=jnp.where(saved, raw.ts["run"], jnp.nan) if given_ts is None else given_ts,
        states=states,
        result=code,
        stats=stats,
        system=given,
        start=given_start,
        method=", ".join(type(x).__name__ for x in (solver, coordinates.split or chart) if x is not None),
        event=None if event is None else _which(raw.event_mask["user"]),
    )


def _stats(raw: Any, duration, looked: Preview | None) -> dict[str, Any]:
    stats = {name: raw.stats[name] for name in ("num_steps", "num_accepted_steps", "num_rejected_steps")}
    stats |= {"step": duration / jnp.maximum(stats["num_accepted_steps"], 1)}
    return stats if looked is None else stats | {"unseen": looked.unseen}


class _Coordinates(NamedTuple):
    """What Diffrax steps: `terms` and where they begin; those of a `split`, of `equations` in a chart, or of a `Lagrangian`
    (None both)."""

    terms: Tracked
    y0: Tracked
    split: Any
    equations: Moving | Condensed | None

    @staticmethod
    def of(system: Any, scene: Any, start: Any, t0, chart: AbstractChart | None, solver: Any) -> "_Coordinates":
        split = equations = None
        if isinstance(solver, AbstractSymplectic):
            split = system.split(start, t0, solver.small_kicks, scene)
            term, phase = SplitTerm(split), split.encode(start)
            counted = phase.q is not None
        elif chart is not None:
            equations = system.equations(chart, scene)
            term, phase = diffrax.ODETerm(_Flow(equations)), equations.encode(t0, start)
            counted = not chart.counts_turns
        else:
            term, phase, counted = diffrax.ODETerm(_Flow(system)), start, False
        y0 = Tracked(phase, remainder=None, turns=start.turns if counted else None)
        if t0.dtype == jnp.float32 and split is None:
            y0 = y0._replace(remainder=jax.tree.map(jnp.zeros_like, y0.phase))
        return _Coordinates(Tracked(term, diffrax.ODETerm(_idle), diffrax.ODETerm(_idle)), y0, split, equations)

    def decode(self, t, y: Tracked) -> Any:
        turns = 0.0 if y.turns is None else y.turns
        if self.split is not None:
            return self.split.decode(t, y.phase, turns)
        return y.phase if self.equations is None else self.equations.decode(t, y.phase.q, y.phase.v, turns)

    # In one array: of several that a loop writes, XLA may copy each as a whole for every row.

    def packed(self, t, y: Tracked, args: Any) -> Array:
        del args
        return ravel_pytree(self.decode(t, y))[0]

    def unpacked(self, t0, rows: Array) -> Any:
        return jax.vmap(ravel_pytree(self.decode(t0, self.y0))[1])(rows)


def _are_given(controller: Any, dt0: Any, n_steps: Any) -> bool:
    """Whether steps do not adapt."""
    return n_steps is not None or (dt0 is not None and controller is None)


def _steps(
    scene: Any, scales: Scales | None, y0: Tracked, t0, t1, controller, dt0, n_steps, saves: bool,
    ends, knots, looked: Preview | None, atol, longest,
) -> Any:  # fmt: skip
    """The step size controller: what was given, or by the error, with steps that end at `ends`."""
    if n_steps is not None:
        return diffrax.StepTo(jnp.linspace(t0, t1, n_steps + 1))
    if _are_given(controller, dt0, n_steps):
        return diffrax.ConstantStepSize()
    if controller is not None:
        return controller if knots is None else _ending_at(Stops.of(t0, t1[None], knots, None), controller, t0, False)
    if looked is not None:  # error control sees what changes, once a step ends there
        most = (t1 - t0) / jnp.maximum(looked.mean_steps, 1.0)
        longest = most if longest is None else jnp.minimum(most, longest)
    by_error = _by_error(scene, scales, y0, t1 - t0, atol, longest)
    return _ending_at(Stops.of(t0, ends, knots, looked), by_error, t0, saves)


def by_the_clock(times: Any, saveat: diffrax.SaveAt | None, event: diffrax.Event | None) -> tuple[Any, Any]:
    """What its user saves and ends a run by, with the user's times, for a run that begins at zero."""
    clock = times.clock
    if clock is None:
        return saveat, event
    if saveat is not None:
        inner, ts = saveat.subs.fn, saveat.subs.ts
        ts = None if ts is None else jnp.asarray(since(clock, ts), times.end.dtype)
        saveat = eqx.tree_at(
            lambda saveat: (saveat.subs.fn, saveat.subs.ts),
            saveat,
            (lambda t, y, args: inner(clock + t, y, args), ts),
            is_leaf=lambda x: x is None,
        )
    if event is not None:

        def delayed(condition):
            return lambda t, y, args, **rest: condition(clock + t, y, args, **rest)

        conditions = jax.tree.map(delayed, event.cond_fn, is_leaf=callable)
        event = diffrax.Event(conditions, event.root_finder, event.direction)
    return saveat, event


class _Flow(eqx.Module):
    """The first-order form of Lagrange's equations."""

    equations: Lagrangian | Moving | Condensed

    def __call__(self, t, y, args):
        del args
        return Phase(y.v, self.equations.acceleration(t, y.q, y.v))


class _Margin(eqx.Module):
    """What is left until the model ends, each part above zero: room for compression, for growth, for turning."""

    body: Projection | None  # None: one uniform strain, which is its own field
    critical: Float[Array, ""] | None  # square of the rate beyond which no static strain holds, of `QuasiStatic`

    @staticmethod
    def of(system: System, scene: DiscreteSystem) -> "_Margin":
        critical = None
        if scene.condensed:
            critical = critical_square(scene.body)
            if isinstance(system.rod, Rod):  # every rung is stiffer than the rod
                critical = jnp.minimum(critical, jax.lax.stop_gradient(continuum.critical_rate(system)) ** 2)
        return _Margin(None if scene.uniform else scene.body, critical)

    def __call__(self, state: State) -> Float[Array, " 3"]:
        strain = state.amplitudes if self.body is None else self.body.field(state.amplitudes)
        square = jnp.sum(state.direction_rate**2)
        return jnp.stack(
            [
                jnp.min(strain) - _COLLAPSED,
                1 - jnp.max(jnp.abs(strain)) / _DIVERGED,
                jnp.ones_like(square) if self.critical is None else 1 - square / self.critical,
            ]
        )


def _idle(t, y, args):
    del t, args
    return jax.tree.map(jnp.zeros_like, y)


class _NaturalNorm(eqx.Module):
    """Root mean square of the weighted errors of coordinates and velocities."""

    weights: Phase

    def __call__(self, error: Tracked | Phase) -> Float[Array, ""]:
        phase = error.phase if isinstance(error, Tracked) else error  # an implicit solver asks about the phase alone
        weighted = jax.tree.map(jnp.multiply, phase, self.weights)
        squares = jnp.concatenate([jnp.ravel(x) ** 2 for x in jax.tree.leaves(weighted)])
        if squares.size == 0:  # a rigid rod that is driven has no coordinates
            return jnp.zeros((), squares.dtype)
        return jnp.sqrt(jnp.mean(squares))


def _ending_at(stops: Stops, steps: Any, t0, saves: bool) -> Any:
    """Steps that end where loads change and, as interpolation would cost digits at tight tolerances, where one is saved.

    A step that is cut off has no derivative by the place of the cut: its error would be all that is differentiated.
    """
    if stops.inner is None:
        return diffrax.ClipStepSizeController(steps, step_ts=jax.lax.stop_gradient(stops.ends)) if saves else steps
    return diffrax.ClipStepSizeController(steps, step_ts=stops.distinct(t0))


def _by_error(scene: Any, scales: Scales | None, y0: Tracked, duration, atol, longest) -> diffrax.PIDController:
    if scales is None:  # any Lagrangian
        return diffrax.PIDController(rtol=atol, atol=atol, dtmin=_least_step(duration), force_dtmin=False)
    weight = jnp.ones_like(y0.phase.q)
    if scene.motion.flies:
        weight = weight.at[-scene.motion.dimension :].set(1 / scene.length)
    slowest, fastest = _natural_rates(scales)
    # At rest there is no error to see, yet a gradient asks how the rod would move: steps resolve its fastest rate anyway.
    # The eighth root because the solver is of order 8; 4.5 is where Dopri8's error of a harmonic meets the tolerance.
    dtmax = 4.5 * (atol / 1e-4) ** 0.125 / fastest
    dtmax = dtmax if longest is None else jnp.minimum(dtmax, longest)
    norm = _NaturalNorm(Phase(weight, weight / slowest))
    return diffrax.PIDController(
        rtol=0.0, atol=atol, norm=norm, dtmin=_least_step(duration), dtmax=dtmax, force_dtmin=False
    )


def _natural_rates(scales: Scales) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Rates in 1/s of the slowest vibration, by which velocities are measured, and of the fastest, both with the turning."""
    if not scales.axial.size:
        return scales.slow, scales.slow
    return jnp.hypot(scales.slow, scales.axial[0]), jnp.hypot(scales.slow, scales.axial[-1])


def _longest_step(scales: Scales, solver, split):
    """Above it given steps are unstable or do not see the motion; an implicit method may mean to overlook it."""
    if split is not None:
        return split.longest_step(solver, scales.spin)
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        return jnp.inf
    return jnp.pi / _natural_rates(scales)[1]


def _least_step(duration):
    """Far below any step that a save time may cut off, so that only a singular motion gets there."""
    return 1e-2 * jnp.finfo(duration.dtype).eps * duration


def _saveat(saveat: diffrax.SaveAt | None, ts, coordinates: _Coordinates) -> diffrax.SaveAt:
    if saveat is None:
        run = diffrax.SubSaveAt(t1=ts is None, ts=ts, fn=coordinates.packed)
    else:
        inner = saveat.subs.fn

        def decoded(t, y, args):
            return inner(t, coordinates.decode(t, y), args)

        run = eqx.tree_at(lambda sub: sub.fn, saveat.subs, decoded)
    return diffrax.SaveAt(subs={"run": run, "end": diffrax.SubSaveAt(t1=True)})


def _begun(event: diffrax.Event, system, scene, start, chart: AbstractChart | None, t0, t1) -> diffrax.Event:
    """The event, whose conditions that are zero at the start count from there on: over the time passed since, or its square.

    So a run that begins on a level ends when it comes back to it.
    """
    if isinstance(system, System):
        equations = system.equations(default_chart(system) if chart is None else chart, scene)
        begin = equations.encode(t0, start)
        decode: Any = equations.decode
    else:
        equations, begin, decode = system, start, lambda t, q, v: Phase(q, v)
    acceleration = equations.acceleration(t0, *begin)

    def onward(condition):
        def value(passed):
            q = begin.q + begin.v * passed + acceleration * (passed**2 / 2)
            return condition(t0 + passed, decode(t0 + passed, q, begin.v + acceleration * passed), None)

        if jax.eval_shape(value, t0).dtype == bool:
            return condition

        def slope(passed):
            return jax.jvp(value, (passed,), (jnp.ones_like(passed),))

        zero = jnp.zeros_like(t0)
        (first, rise), (_, bend) = jax.jvp(slope, (zero,), (jnp.ones_like(zero),))
        duration, rounding = t1 - t0, 64 * jnp.finfo(t0.dtype).eps
        by_rise = jnp.abs(first) <= rounding * duration * jnp.abs(rise)
        by_bend = (jnp.abs(first) <= rounding * duration**2 * jnp.abs(bend)) & ~(
            jnp.abs(rise) > rounding * duration * jnp.abs(bend)
        )

        def counted(t, y, args, **rest):
            passed = t - t0
            over = jnp.where(passed > 0, passed, 1.0)
            value = condition(t, y, args, **rest)
            later = jnp.where(by_bend, value / over**2, value / over)
            return jnp.where(by_rise | by_bend, jnp.where(passed > 0, later, jnp.where(by_bend, bend / 2, rise)), value)

        return counted

    conditions = jax.tree.map(onward, event.cond_fn, is_leaf=callable)
    return diffrax.Event(conditions, event.root_finder, event.direction)


def _which(happened: PyTree[Bool[Array, ""]]) -> Int[Array, ""]:
    """The first of the conditions that happened; -1 if none did."""
    found = jnp.stack(jax.tree.leaves(happened))
    return jnp.where(jnp.any(found), jnp.argmax(found), -1)


def _events(event: diffrax.Event | None, coordinates: _Coordinates, margin: _Margin | None) -> diffrax.Event:
    """What ends every run, as one number that falls through zero, beside the user's event."""

    def room(t, y, args, **_):
        room = jnp.ones(()) if margin is None else jnp.min(margin(coordinates.decode(t, y)))
        # In JAX's default type, whatever the run's: Diffrax compares it with a literal.
        return jnp.where(_finite(y), room, -1.0).astype(float)

    if event is None:
        return diffrax.Event(room, EventTime(), direction=False)

    def on_state(condition):
        return lambda t, y, args, **rest: condition(t, coordinates.decode(t, y), args, **rest)

    return diffrax.Event(
        {"margin": room, "user": jax.tree.map(on_state, event.cond_fn, is_leaf=callable)},
        EventTime() if event.root_finder is None else mappable(event.root_finder),
        {"margin": False, "user": event.direction},
    )


def _finite(y: PyTree[Array]) -> Any:
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(y)]))


def _result(raw: Any, finite, room, valid, user_event: bool) -> Any:
    """The code of a run, from Diffrax's result and what room was left at its end."""
    codes, result = diffrax.RESULTS, raw.result
    code = Result.where(result == codes.max_steps_reached, Result.max_steps, Result.diverged)
    code = Result.where(diffrax.is_okay(result), Result.ok, code)
    stopped = raw.event_mask["margin"] if user_event else raw.event_mask
    why = Result.where(room[1] < 0.5, Result.diverged, Result.collapsed)
    why = Result.where(room[2] < 1e-3, Result.past_critical, why)
    why = Result.where(finite, why, Result.non_finite)
    code = Result.where(stopped, why, code)
    return Result.where(valid, code, Result.invalid)
