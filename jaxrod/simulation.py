"""`simulate`: from a scene and a start to a `Solution`, by Diffrax.

**Accuracy.**  `tolerance` is the relative error of the tip's position after 1,000 axial periods.  Errors of single steps
are measured in natural units (radians and strains for coordinates; rates over the natural rate of the scene) and held
10^4 times below it: a step's error counts about ten steps per period, 1,000 periods.
"""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, PyTree

from . import checks
from .chart import AbstractChart, Angles, Director, Embedded
from .lagrangian import Lagrangian, Phase
from .motion import Flight, State
from .result import Result, SimulationError
from .solution import Solution
from .system import System
from .turns import CountTurns

_DEFAULT_TOLERANCE = {"float64": 1e-8, "float32": 1e-4}
_LEAST_TOLERANCE = {"float64": 1e-12, "float32": 1e-5}
_LOCAL = 1e-4  # error of a step over `tolerance`
_COLLAPSED = -1 + 1e-6
_DIVERGED = 1e6


def default_solver(system: System | Lagrangian) -> diffrax.AbstractSolver:
    """The solver that `simulate` takes when none is given: Dormand and Prince's method of order 8."""
    del system
    return diffrax.Dopri8()


def default_chart(system: System) -> AbstractChart:
    """The coordinates that `simulate` takes when none are given.

    In the plane the angle, which has no pole and counts its turns.  In space the embedded q = (1 + eps) d; for a rigid
    rod, and in float32, where 1 + eps would round the strain away, the director beside the strain.
    """
    if system.motion.dimension == 2:
        return Angles()
    if system.basis.n == 1 and checks.float_type(system) == jnp.float64:
        return Embedded()
    return Director()


def simulate(
    system: System | Lagrangian,
    start: State | tuple[Array, Array],
    *,
    ts: Any = None,
    t1: Any = None,
    t0: Any = 0.0,
    tolerance: Any = None,
    chart: AbstractChart | None = None,
    solver: diffrax.AbstractSolver | None = None,
    stepsize_controller: diffrax.AbstractStepSizeController | None = None,
    dt0: Any = None,
    n_steps: int | None = None,
    saveat: diffrax.SaveAt | None = None,
    event: diffrax.Event | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    progress_meter: diffrax.AbstractProgressMeter | None = None,
    max_steps: int = 2**20,
    throw: bool = True,
) -> Solution:
    """Motion of `system` from `start` at time `t0`.

    **Arguments:**

    - `system`: a `System`, or any `Lagrangian`.
    - `start`: a state, made by `system.state(...)`; for a `Lagrangian` a pair (q, v).
    - `ts`: increasing times in s to save at (T,); or `t1`: the end in s, saving it alone.
    - `tolerance`: relative error of the tip's position after 1,000 axial periods; 1e-8 in float64 (at least 1e-12),
      1e-4 in float32 (at least 1e-5).
    - `chart`: the coordinates to compute in, `Angles()`, `Embedded()` or `Director()`; see `default_chart`.
    - `n_steps`: take so many equal steps instead of adapting them.
    - `solver`, `stepsize_controller`, `dt0`, `saveat`, `event`, `adjoint`, `progress_meter`, `max_steps`: as in
      `diffrax.diffeqsolve`.  `SaveAt(fn=)` and events receive a `State`.  `solver` alone keeps the default step size
      control, `dt0` alone takes constant steps.  Forward-mode derivatives need `adjoint=diffrax.ForwardMode()`.
    - `throw`: raise `SimulationError` if the run does not reach its end.  Under a transformation nothing is raised.

    **Returns:** a `Solution`.  Whatever could not be computed is NaN there, and `result` says why.

    **Raises:** `ValueError` for inputs that make no sense; `SimulationError`, which carries the solution.

    Works under `jax.jit`, `jax.vmap` and `jax.grad` in any nesting:

    >>> import jax, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81)
    >>> def end(rate):
    ...     return jaxrod.simulate(system, system.state(rate=rate), t1=0.1).angle[-1]
    >>> print(jax.vmap(jax.grad(end))(jax.numpy.array([10.0, 15.0])).round(4))
    [0.0983 0.0978]
    """
    is_rod = isinstance(system, System)
    if not is_rod and not isinstance(system, Lagrangian):
        raise ValueError(f"system={system!r} cannot be simulated; give a System, or Lagrangian(function of t, q, v).")
    if is_rod and not isinstance(start, State):
        raise ValueError(f"start={start!r} is not a state; make one by system.state(angle=..., rate=...).")
    dtype = checks.float_type(system, start)
    system, start = jax.tree.map(lambda x: x.astype(dtype) if eqx.is_inexact_array(x) else x, (system, start))
    if is_rod:
        chart = default_chart(system) if chart is None else chart
        _check_start(system, start)
    else:
        start = Phase(*(jnp.asarray(x, dtype) for x in start))

    t0, t1, ts = _times(ts, t1, t0, saveat, dtype)
    step_keywords = {"solver": solver, "stepsize_controller": stepsize_controller, "dt0": dt0, "n_steps": n_steps}
    given = [name for name, value in step_keywords.items() if value is not None]
    if tolerance is not None and given:
        raise ValueError(f"tolerance={tolerance} chooses solver and steps itself; leave out {', '.join(given)}.")
    atol = _step_tolerance(tolerance, dtype)
    solver = default_solver(system) if solver is None else solver
    _check_steps(solver, stepsize_controller, dt0, n_steps)
    solution = _integrate(
        system, start, chart, t0, t1, ts, atol, solver, stepsize_controller, dt0, n_steps, saveat, event,
        diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        diffrax.NoProgressMeter() if progress_meter is None else progress_meter,
        max_steps,
    )  # fmt: skip
    if throw and checks.known(solution.stats["num_steps"]) and not np.all(solution.ok):
        raise SimulationError(solution.complaint(), solution)
    return solution


@eqx.filter_jit
def _integrate(
    system, start, chart, t0, t1, ts, atol, solver, stepsize_controller, dt0, n_steps, saveat, event, adjoint,
    progress_meter, max_steps,
):  # fmt: skip
    lagrangian = system if chart is None else system.lagrangian(chart)
    y0 = start if chart is None else chart.encode(system.motion, start)
    terms: PyTree = diffrax.ODETerm(_Flow(lagrangian))
    strains = chart is not None and system.basis.n > 0
    counting = chart is not None and not chart.counts_turns
    if counting:
        y0, terms, solver = (y0, start.turns), (terms, diffrax.ODETerm(_idle)), CountTurns(solver)

    def decode(y):
        if chart is None:
            return y
        phase, turns = y if counting else (y, 0.0)
        return chart.decode(system.motion, phase.q, phase.v, turns)

    if n_steps is not None:
        stepsize_controller = diffrax.StepTo(jnp.linspace(t0, t1, n_steps + 1))
    elif stepsize_controller is None and dt0 is not None:
        stepsize_controller = diffrax.ConstantStepSize()
    elif stepsize_controller is None:
        stepsize_controller = _adaptive(system, start, y0, counting, t1 - t0, atol)
        if ts is not None:  # what is saved is the end of a step: interpolation would cost digits at tight tolerances
            stepsize_controller = diffrax.ClipStepSizeController(stepsize_controller, step_ts=ts)

    raw = diffrax.diffeqsolve(
        terms, solver, t0, t1, dt0, y0,
        saveat=_saveat(saveat, ts, decode), stepsize_controller=stepsize_controller, adjoint=adjoint,
        event=_events(event, decode, strains, t1.dtype), max_steps=max_steps, throw=False,
        progress_meter=progress_meter,
    )  # fmt: skip

    saved = jnp.isfinite(raw.ts["run"])
    states = jax.tree.map(
        lambda x: jnp.where(saved.reshape((-1,) + (1,) * (x.ndim - 1)), x, jnp.nan), raw.ys["run"]
    )  # fmt: skip
    stats = {name: raw.stats[name] for name in ("num_steps", "num_accepted_steps", "num_rejected_steps")}
    stats["t_end"] = raw.ts["end"][-1]
    last = jax.tree.map(lambda y: y[-1], raw.ys["end"])
    end = _finite(last), decode(last).amplitudes if strains else jnp.zeros(0)
    return Solution(
        ts=jnp.where(saved, raw.ts["run"], jnp.nan) if ts is None else ts,
        states=states,
        result=_result(raw, end, system.valid(start) if chart is not None else True, event is not None),
        stats=stats,
        system=system,
        method=", ".join(type(x).__name__ for x in (raw_solver(solver), chart) if x is not None),
    )


def raw_solver(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    return solver.solver if isinstance(solver, CountTurns) else solver


class _Flow(eqx.Module):
    """The first-order form of Lagrange's equations."""

    lagrangian: Lagrangian

    def __call__(self, t, y, args):
        del args
        return Phase(y.v, self.lagrangian.acceleration(t, y.q, y.v))


def _idle(t, y, args):
    del t, args
    return jnp.zeros_like(y)


class _NaturalNorm(eqx.Module):
    """Root mean square of the weighted errors of coordinates and velocities."""

    weights: PyTree[Array]

    def __call__(self, error: PyTree[Array]) -> Float[Array, ""]:
        weighted = jax.tree.map(jnp.multiply, error, self.weights)
        squares = jnp.concatenate([jnp.ravel(x) ** 2 for x in jax.tree.leaves(weighted)])
        return jnp.sqrt(jnp.mean(squares))


def _adaptive(system, start, y0, counting, duration, atol) -> diffrax.PIDController:
    if isinstance(system, Lagrangian):
        return diffrax.PIDController(rtol=atol, atol=atol, dtmin=_least_step(duration), force_dtmin=False)
    phase = y0[0] if counting else y0
    weight = jnp.ones_like(phase.q)
    if isinstance(system.motion, Flight):
        weight = weight.at[-system.motion.dimension :].set(1 / system.rod.length)
    weights: Any = Phase(weight, weight / _natural_rate(system, start, duration))
    weights = jax.lax.stop_gradient((weights, jnp.zeros_like(start.turns)) if counting else weights)
    return diffrax.PIDController(
        rtol=0.0, atol=atol, norm=_NaturalNorm(weights), dtmin=_least_step(duration), force_dtmin=False
    )


def _natural_rate(system: System, start: State, duration) -> Float[Array, ""]:
    """The rate in 1/s by which velocities are measured: axial vibration, spin, swing, and one over the run's length."""
    body = system.body
    square = start.direction_rate @ start.direction_rate + 1 / duration**2
    if system.basis.n:
        square = square + body.stiffness_matrix[0, 0] / body.mass_matrix[1, 1]
    if system.gravity is not None and not isinstance(system.motion, Flight):
        square = square + system.gravity * jnp.abs(body.first_moments[0]) / body.mass_matrix[0, 0]
    return jnp.sqrt(square)


def _least_step(duration):
    """Far below any step that a save time may cut off, so that only a singular motion gets there."""
    return 1e-2 * jnp.finfo(duration.dtype).eps * duration


def _saveat(saveat, ts, decode) -> diffrax.SaveAt:
    if saveat is None:
        run = diffrax.SubSaveAt(ts=ts) if ts is not None else diffrax.SubSaveAt(t1=True)
    else:
        run = saveat.subs
    inner = run.fn

    def fn(t, y, args):
        return inner(t, decode(y), args)

    run = eqx.tree_at(lambda sub: sub.fn, run, fn)
    return diffrax.SaveAt(subs={"run": run, "end": diffrax.SubSaveAt(t1=True)})


def _events(event: diffrax.Event | None, decode, strains: bool, dtype) -> diffrax.Event:
    """What ends every run, as one number that falls through zero, beside the user's event."""

    def margin(t, y, args, **_):
        room = jnp.ones(())
        if strains:
            strain = decode(y).amplitudes
            room = jnp.minimum(jnp.min(strain) - _COLLAPSED, 1 - jnp.max(jnp.abs(strain)) / _DIVERGED)
        # In JAX's default type, whatever the run's: Diffrax compares it with a literal.
        return jnp.where(_finite(y), room, -1.0).astype(float)

    if event is None:
        rounding = 64 * float(jnp.finfo(dtype).eps)
        return diffrax.Event(margin, optx.Bisection(rtol=rounding, atol=rounding, flip=True), direction=False)

    def on_state(condition):
        return lambda t, y, args, **rest: condition(t, decode(y), args, **rest)

    return diffrax.Event(
        {"margin": margin, "user": jax.tree.map(on_state, event.cond_fn, is_leaf=callable)},
        optx.Newton(rtol=1e-12, atol=1e-12) if event.root_finder is None else event.root_finder,
        {"margin": False, "user": event.direction},
    )


def _finite(y: PyTree[Array]) -> Any:
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(y)]))


def _result(raw: diffrax.Solution, end, valid, user_event: bool) -> Any:
    """The code of a run, from Diffrax's result and the phase at its end."""
    codes, result = diffrax.RESULTS, raw.result
    code = Result.where(result == codes.max_steps_reached, Result.max_steps, Result.diverged)
    code = Result.where(diffrax.is_okay(result), Result.ok, code)
    finite, strain = end
    stopped = raw.event_mask["margin"] if user_event else raw.event_mask
    why = Result.where(jnp.max(jnp.abs(strain), initial=0.0) > 0.5 * _DIVERGED, Result.diverged, Result.collapsed)
    why = Result.where(finite, why, Result.non_finite)
    code = Result.where(stopped, why, code)
    return Result.where(jnp.asarray(valid), code, Result.invalid)


def _times(ts, t1, t0, saveat, dtype) -> tuple[Array, Array, Array | None]:
    if (ts is None) == (t1 is None):
        given = "neither" if ts is None else "both"
        raise ValueError(f"{given} of ts= and t1= given; give ts= (times to save at) or t1= (the end alone).")
    if saveat is not None and (ts is not None or saveat.dense or not isinstance(saveat.subs, diffrax.SubSaveAt)):
        raise ValueError("saveat= goes with t1=, without dense= and subs=; give SaveAt(ts=...), SaveAt(steps=True), or ts=.")
    t0 = checks.number("t0", t0).astype(dtype)
    if ts is None:
        t1 = checks.number("t1", t1).astype(dtype)
        if checks.known(t1) and checks.known(t0) and t1 <= t0:
            raise ValueError(f"t1={checks.shown(t1)} does not lie after t0={checks.shown(t0)}.")
        return t0, t1, None
    ts = checks.number("ts", ts, (max(1, jnp.size(ts)),)).astype(dtype)
    if checks.known(ts) and not np.all(np.diff(ts) > 0):
        first = int(np.argmin(np.diff(ts) > 0))
        raise ValueError(
            f"ts must increase, but ts[{first}]={ts[first]:.6g} is followed by {ts[first + 1]:.6g}; sort it and drop doubles."
        )
    if checks.known(ts) and checks.known(t0) and (ts[0] < t0 or ts[-1] <= t0):
        raise ValueError(f"ts={checks.shown(ts)} does not lie after the start t0={checks.shown(t0)}; give later times, or t0=.")
    return t0, ts[-1], ts


def _step_tolerance(tolerance, dtype) -> Float[Array, ""]:
    name = jnp.dtype(dtype).name
    if tolerance is None:
        tolerance = _DEFAULT_TOLERANCE[name]
    tolerance = checks.positive("tolerance", tolerance, "relative error of the tip's position")
    if checks.known(tolerance) and tolerance < _LEAST_TOLERANCE[name]:
        other = "call jaxrod.configure() and build the scene in float64" if name == "float32" else "take a larger one"
        raise ValueError(
            f"tolerance={checks.shown(tolerance)} is beyond {name}, which reaches {_LEAST_TOLERANCE[name]:.0e}; {other}."
        )
    return jnp.maximum(_LOCAL * tolerance.astype(dtype), 32 * jnp.finfo(dtype).eps)


def _check_steps(solver, stepsize_controller, dt0, n_steps) -> None:
    if n_steps is not None:
        if n_steps < 1 or int(n_steps) != n_steps:
            raise ValueError(f"n_steps={n_steps} must be a positive whole number.")
        if dt0 is not None or stepsize_controller is not None:
            raise ValueError(f"n_steps={n_steps} fixes the steps; leave out dt0= and stepsize_controller=.")
    elif dt0 is None and stepsize_controller is None and not isinstance(solver, diffrax.AbstractAdaptiveSolver):
        raise ValueError(f"solver={type(solver).__name__}() estimates no error to adapt steps by; give n_steps=.")


def _check_start(system: System, start: State) -> None:
    dimension, n, flight = system.motion.dimension, system.basis.n, isinstance(system.motion, Flight)
    if start.direction.shape != (dimension,) or start.amplitudes.shape != (n,) or (start.center is None) == flight:
        raise ValueError(
            f"start has director of shape {start.direction.shape} and strains of shape {start.amplitudes.shape}, but this "
            f"scene needs ({dimension},) and ({n},){' and a center' if flight else ''}; make it by system.state(...), and "
            "map over many with jax.vmap."
        )
