"""`simulate`: from a scene and a start to a `Solution`, by Diffrax.

**Accuracy.**  `tolerance` is the relative error of the tip's position after 1,000 axial periods.  Errors of single
steps are measured in natural units (radians and strains for coordinates; rates over the natural rate of the scene) and
held 10^4 times below it: about ten steps a period, 1,000 periods.  Energy is kept as well by equal steps, which most scenes
take; by steps that adapt (forces that depend on rates) to the tolerance alone: damping weaker than that, of a quality
beyond 1e9, is not seen in it.  In float32 the rounding of the turning itself comes on
top, 6e-7 for each radian turned; after a hundred turns, as the rounding of the energy adds up, up to five times that.
"""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .accuracy.error_budget import budgets
from .accuracy.quantity import AbstractQuantity, as_quantity
from .accuracy.run_plan import Plan
from .core import precision, tracing, units, validation
from .core.precision import in_type
from .core.result import Result, SimulationError
from .integrators.multistep import AbstractMultistep
from .integrators.reversal import reversible
from .integrators.runge_kutta import Unrolled
from .integrators.symplectic import AbstractSymplectic
from .mechanics.chart import AbstractChart
from .mechanics.lagrangian import Lagrangian, Phase
from .mechanics.system import System
from .motions.state import State, check_start
from .rods import plausibility
from .rods.rod import Rod
from .runs import arguments
from .runs.adaptive_steps import by_the_clock, integrate
from .runs.defaults import best_solver, by_equal_steps, default_chart
from .runs.fixed_steps import step_through
from .runs.invariants import is_closed
from .runs.solution import Solution

_LOCAL = 1e-4  # error of a step over `tolerance`
_CLOSER = 8  # steps in one that was too long for a load
_LEAST_LOCAL = {"float64": 7e-15, "float32": 3e-8}  # below it rounding is all that the error estimate sees


def simulate(
    system: System | Lagrangian,
    start: State | tuple[Array, Array],
    *,
    ts: Any = None,
    t1: Any = None,
    t0: Any = 0.0,
    tolerance: Any = None,
    chart: AbstractChart | None = None,
    solver: diffrax.AbstractSolver | AbstractMultistep | None = None,
    stepsize_controller: diffrax.AbstractStepSizeController | None = None,
    dt0: Any = None,
    n_steps: Any = None,
    saveat: diffrax.SaveAt | None = None,
    event: diffrax.Event | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    progress_meter: diffrax.AbstractProgressMeter | None = None,
    max_steps: int = 2**20,
    budget: AbstractQuantity | Callable | list | tuple | None = None,
    throw: bool = True,
) -> Solution:
    """Motion of `system` from `start` at time `t0`.

    **Arguments:**

    - `system`: a `System`, or any `Lagrangian`.
    - `start`: a state, made by `system.state(...)`; for a `Lagrangian` a pair (q, v).
    - `ts`: increasing times in s to save at (T,); or `t1`: the end in s, saving it alone (of a run that stops earlier, where
      it stopped: `sol.ts` says when).
    - `tolerance`: relative error of the tip's position after 1,000 axial periods; 1e-8 in float64 (at least 1e-12),
      1e-4 in float32 (at least 1e-5).  Or what `jaxrod.plan` has found, to follow it: its rung, solver, steps, float type.
    - `chart`: the coordinates to compute in, `Angles()`, `Embedded()` or `Director()`; see `default_chart`.
    - `n_steps`: take so many equal steps instead of adapting them, with `ts` at least one to each of them; under a
      transformation a known number, but of a symplectic or multistep solver, which takes a traced one too.
    - `solver`, `stepsize_controller`, `dt0`, `saveat`, `event`, `adjoint`, `progress_meter`, `max_steps`: as in
      `diffrax.diffeqsolve`.  `SaveAt(fn=)` and events receive a `State`.  `solver` alone keeps the default step size
      control, `dt0` alone takes constant steps.  Forward-mode derivatives need `adjoint=diffrax.ForwardMode()`.
    - `budget`: a quantity, such as `jaxrod.FinalTip()`, or a function of the solution, whose error is measured by four
      more runs: `sol.budget`; by five where it looks at times that are not saved.  Of a list of them, which share these,
      `sol.budget` is a tuple.
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
    [0.099  0.0967]
    """
    in_s = {"ts": ts, "t1": t1, "t0": t0, "dt0": dt0}
    ts, t1, t0, dt0 = (units.plain(name, time, "s") for name, time in in_s.items())
    if isinstance(tolerance, Plan):
        return _follow(
            tolerance, system, start, t0=t0, ts=ts, t1=t1, chart=chart, solver=solver, dt0=dt0, n_steps=n_steps,
            stepsize_controller=stepsize_controller, saveat=saveat, event=event, adjoint=adjoint,
            progress_meter=progress_meter, max_steps=max_steps, budget=budget, throw=throw,
        )  # fmt: skip
    arguments.check_scene(system, start, chart)
    dtype = precision.float_type(system, start)
    precision.warn_if_lowered(dtype, system, start)
    system, start = in_type(dtype, (system, start))
    if isinstance(system, System) and isinstance(start, State):
        check_start(system.motion, system.basis.n, start)
    else:
        start = Phase(*(jnp.asarray(x, dtype) for x in start))

    arguments.check_run(start, saveat, event, progress_meter, stepsize_controller, throw)
    asked_times = {"t0": t0, "t1": t1} if ts is None else {"t0": t0, "ts": ts}
    times = arguments.times(ts, t1, t0, saveat, dtype, by_the_clock=stepsize_controller is not None)
    if adjoint is not None and not isinstance(adjoint, diffrax.AbstractAdjoint | Reversible):
        raise ValueError(
            f"adjoint={validation.given(adjoint)} is no adjoint; give an instance, such as diffrax.ForwardMode()."
        )
    max_steps = validation.count("max_steps", max_steps, 1, "steps")
    step_keywords = {"solver": solver, "stepsize_controller": stepsize_controller, "dt0": dt0, "n_steps": n_steps}
    given = [name for name, value in step_keywords.items() if value is not None]
    if tolerance is not None and given:
        raise ValueError(
            f"tolerance={validation.brief(tolerance)} chooses solver and steps itself; leave out {', '.join(given)}."
        )
    asked = arguments.checked_tolerance(tolerance, dtype, (system, start))
    several = isinstance(budget, list | tuple)
    if several and (not budget or any(each is None for each in budget)):
        raise ValueError(
            f"budget={validation.given(budget)} asks for nothing; give a quantity, such as FinalTip(), or leave it out."
        )
    if budget is not None and isinstance(system, Lagrangian):
        raise ValueError(
            f"budget={validation.given(budget)} is of a System; of any Lagrangian compare runs of two tolerances."
        )
    quantities = [as_quantity(each) for each in (budget if several else [budget])]

    # Equal steps from save time to save time need nothing of Diffrax; what does goes through Diffrax.
    plain = all(x is None for x in (stepsize_controller, dt0, saveat, event, progress_meter))
    plain = plain and (adjoint is None or isinstance(adjoint, Reversible | diffrax.ForwardMode))
    # A number that hides in a closure has no reverse derivative through steps that are undone.
    hidden = isinstance(system, System) and tracing.closes_over_traced((system.forces, system.motion))
    hidden = hidden and not isinstance(adjoint, diffrax.ForwardMode)
    plain = plain and not hidden
    chosen, why = _chosen(system, solver, plain and chart is None, hidden)
    arguments.check_steps(chosen, stepsize_controller, dt0, n_steps, plain)
    if isinstance(chosen, AbstractSymplectic):
        arguments.check_split(system, chosen, chart)
    elif isinstance(adjoint, Reversible):
        raise ValueError(f"adjoint=Reversible() runs symplectic solvers backwards, not {type(chosen).__name__}.")
    if isinstance(chosen, AbstractMultistep):
        arguments.check_multistep(system, chosen, plain and chart is None)
    unrolled = isinstance(chosen, Unrolled) and isinstance(system, System) and chart is None
    equal = plain and (by_equal_steps(chosen) or unrolled)
    if n_steps is not None and not equal and not tracing.known(n_steps):
        raise ValueError("n_steps= is traced, which only symplectic solvers and Unrolled() take; give a known number.")

    knots, unknown = arguments.knots(system, times, equal, stepsize_controller, n_steps)
    scene = system if times.clock is None else system.delayed(times.clock.astype(dtype))

    def through_diffrax(solver, why, longest=None):
        solution = integrate(
            scene, start, _fitting(scene, chart, solver), times.start, times.end, times.saved,
            jnp.maximum(_LOCAL * asked, _LEAST_LOCAL[asked.dtype.name]),
            solver, stepsize_controller, dt0, n_steps, *by_the_clock(times, saveat, event),
            diffrax.RecursiveCheckpointAdjoint() if adjoint is None or isinstance(adjoint, Reversible) else adjoint,
            diffrax.NoProgressMeter() if progress_meter is None else progress_meter,
            max_steps, longest, knots,
        )  # fmt: skip
        return _explained(solution, why)

    if equal:
        solution = _explained(_step(scene, start, times, chosen, n_steps, asked, max_steps, adjoint, knots), why)
        failed = validation.fails(lambda ok: ok, solution.ok)
        if solver is None and n_steps is None and failed and not bool(solution.result == Result.invalid):
            # Steps that adapt may pass over a load that equal ones met: they are to look as closely.
            longest = None if isinstance(system, System) and is_closed(system) else solution.stats["step"] / _CLOSER
            why = f"adaptive, as equal steps ended with: {Result[solution.result]}"
            solution = through_diffrax(diffrax.Dopri8(), why, longest)
    else:
        solution = through_diffrax(chosen, why)
    solution = _as_asked(solution, system, times, ts, unknown)
    if throw and tracing.known(solution.stats["num_steps"]) and validation.fails(lambda ok: ok, solution.ok):
        raise SimulationError(solution.complaint(), solution)
    _doubt_strain(solution)
    if budget is not None:
        assert isinstance(system, System) and isinstance(start, State)
        if not isinstance(solution.states, State):
            raise ValueError(f"budget={validation.given(budget)} asks whole states; leave out fn= of saveat=.")

        same = {"event": event, "adjoint": adjoint, "max_steps": max_steps, "throw": False}
        alike = {"tolerance": tolerance, "chart": chart, **step_keywords}
        saved = {**asked_times, "saveat": saveat} if ts is None else asked_times

        def run(system, start, least=None, times=None):
            how = alike if least is None else {"tolerance": least}
            return simulate(system, start, **(saved if times is None else {"t0": t0, "ts": times}), **same, **how)

        def own_times(quantity):  # a run of its own for what looks at more than the end that is saved
            looked = quantity.times(t0, t1) if ts is None and saveat is None else None
            return looked if looked is not None and looked.size > 1 else None

        found = budgets(quantities, system, start, solution, run, own_times)
        solution = dataclasses.replace(solution, budget=found if several else found[0])
    return solution


def _follow(plan: Plan, system, start, *, solver, n_steps, stepsize_controller, dt0, chart, **others) -> Solution:
    """A run as planned."""
    own = {"solver": solver, "n_steps": n_steps, "stepsize_controller": stepsize_controller, "dt0": dt0, "chart": chart}
    given = [name for name, value in own.items() if value is not None]
    if given:
        raise ValueError(f"tolerance= is a plan, which chooses them itself; leave out {', '.join(given)}.")
    arguments.check_scene(system, start)
    times = arguments.times(others["ts"], others["t1"], others["t0"], others["saveat"], jnp.result_type(float))
    system, start = plan.applied(system, start, others["t0"])
    return simulate(system, start, **plan.steps(system, start, times.start, times.end), **others)


def _doubt_strain(solution: Solution) -> None:
    """Warn of a run that is known to have stretched a rod beyond all that Hooke's law is for."""
    rod: Any = getattr(solution.system, "rod", None)
    states = solution.states
    hooke = isinstance(rod, Rod) and rod.linear and isinstance(states, State)
    if not hooke or not tracing.known(states.amplitudes) or validation.fails(lambda ok: ok, solution.ok):
        return
    largest = np.max(np.abs(np.asarray(states.amplitudes)[..., :1]), initial=0.0)
    if doubt := plausibility.strain(largest, validation.brief(rod.young)):
        warnings.warn(doubt, stacklevel=3)


class Reversible(eqx.Module):
    """The reverse derivative of a symplectic run, by running it backwards: exact to rounding, in memory that does not
    grow with the number of steps.  The default of symplectic solvers, which have no forward derivative with it.

    >>> import jax, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> def end(rate):
    ...     return jaxrod.simulate(system, system.state(rate=rate), t1=0.1, adjoint=jaxrod.Reversible()).angle[-1]
    >>> print(jax.grad(end)(10.0).round(4))
    0.099
    """


@jax.tree_util.register_pytree_node_class
class Reason(str):
    """A sentence that travels through transformations."""

    def tree_flatten(self):
        return (), str(self)

    @classmethod
    def tree_unflatten(cls, sentence, _):
        return cls(sentence)


def _chosen(system, solver, plain: bool, hidden: bool) -> tuple[Any, str]:
    """The solver, and why it is taken."""
    if solver is not None:
        return solver, "as given"
    if hidden:
        return (
            diffrax.Dopri8(),
            "adaptive, as a function of the scene closes over a traced number; hold it in an eqx.Module",
        )
    if not plain:
        return diffrax.Dopri8(), "adaptive, as a chart, steps, saveat, event, adjoint or meter was given"
    return best_solver(system)


def _fitting(system, chart: AbstractChart | None, solver) -> AbstractChart | None:
    """The chart in which Diffrax runs a scene; symplectic solvers and a `Lagrangian` have their own coordinates."""
    if isinstance(solver, AbstractSymplectic) or not isinstance(system, System):
        return None
    chart = default_chart(system) if chart is None else chart
    system.check_chart(chart)
    return chart


def _explained(solution: Solution, why: str) -> Solution:
    return dataclasses.replace(solution, stats={**solution.stats, "why": Reason(why)})


def _step(system, start, times: arguments.Times, solver, n_steps, tolerance, max_steps, adjoint, knots) -> Solution:
    t0, ts = times.start, times.saved
    ends = times.end[None] if ts is None else ts
    even = ends.size == 1 or _even(t0, ends, times.clock)
    forwards = isinstance(adjoint, diffrax.ForwardMode)
    backwards = isinstance(solver, AbstractSymplectic) and not forwards
    n_steps = None if n_steps is None else jnp.asarray(n_steps, t0.dtype)  # so that another count is the same program
    solution = step_through(
        system, start, t0, ends, solver, n_steps, tolerance, even, ts is None, max_steps, backwards, knots
    )  # fmt: skip
    if isinstance(solver, AbstractMultistep) and not forwards:
        why = f"solver={type(solver).__name__}() has no reverse derivative; take BlanesMoan6(), or adjoint=diffrax.ForwardMode()."
        solution = dataclasses.replace(solution, states=reversible(solution.states, 0, why))
    return solution


def _even(t0, ts, clock) -> bool:
    """Whether save times are known to be equally spaced, from t0 or from the first, to the rounding of their stamps."""
    if ts.dtype != np.float64 or not all(map(tracing.known, (t0, ts, 0.0 if clock is None else clock))):
        return False
    ts = np.asarray(ts)
    ts = ts if ts[0] == t0 else np.concatenate([[t0], ts])
    off = np.abs(ts - np.linspace(ts[0], ts[-1], ts.size)).max()
    stamp = max(abs(ts[-1]), 0.0 if clock is None else abs(float(clock)) + ts[-1])
    return bool(off <= max(1e-9 * (ts[-1] - ts[0]) / ts.size, 4 * np.spacing(stamp)))


def _as_asked(solution: Solution, system, times: arguments.Times, ts, unknown) -> Solution:
    """The solution on the user's clock, of the scene as it was given, with what its loads let one know."""
    if times.clock is not None:
        stamps = times.clock + solution.ts.astype(times.clock.dtype)
        if ts is not None:  # as they were given, to the last digit
            stamps = jnp.where(jnp.isfinite(stamps), jnp.asarray(ts, stamps.dtype), jnp.nan)
        stats = {**solution.stats, "t_end": times.clock + solution.stats["t_end"].astype(times.clock.dtype)}
        solution = dataclasses.replace(solution, ts=stamps, stats=stats, system=system)
    stats = dict(solution.stats)
    unseen, code = stats.pop("unseen", None), solution.result
    if unseen is not None and not tracing.known(unseen):
        code = Result.where((code == Result.ok) & unseen, Result.unseen, code)
    elif unseen is not None and validation.fails(lambda unseen: ~unseen, unseen):
        warnings.warn(Result.unseen.sentence, stacklevel=3)
    if unknown is not None:
        lost = jnp.where(unknown, jnp.nan, 1.0)
        states = jax.tree.map(lambda x: x * lost.astype(x.dtype), solution.states)
        code = Result.where(unknown, Result.invalid, code)
        solution = dataclasses.replace(solution, states=states)
    return dataclasses.replace(solution, result=code, stats=stats)
