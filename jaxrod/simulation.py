"""`simulate`: from a scene and a start to a `Solution`, by Diffrax.

**Accuracy.**  `tolerance` is the relative error of the tip's position after 1,000 axial periods.  Errors of single
steps are measured in natural units (radians and strains for coordinates; rates over the natural rate of the scene) and
held 10^4 times below it: about ten steps a period, 1,000 periods.  In float32 the rounding of the turning itself comes on
top, up to 6e-7 for each radian turned.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import checks
from .budget import budget_of
from .chart import AbstractChart, Angles, Director, Embedded, Strains
from .choice import Plan, in_type
from .integration import integrate
from .lagrangian import Lagrangian, Phase
from .ledger import is_closed
from .motion import Driven, State, check_start
from .multistep import AbstractMultistep, irreversible
from .quantity import AbstractQuantity, as_quantity
from .result import Result, SimulationError
from .solution import Solution
from .stepping import LEAST_TOLERANCE, best_solver, step_through
from .symplectic import ABA864, AbstractSymplectic, BlanesMoan6
from .system import System
from .unrolled import Unrolled

_DEFAULT_TOLERANCE = {"float64": 1e-8, "float32": 1e-4}
_LOCAL = 1e-4  # error of a step over `tolerance`
_CLOSER = 8  # steps in one that was too long for a load
_LEAST_LOCAL = {"float64": 7e-15, "float32": 3e-8}  # below it rounding is all that the error estimate sees


def default_solver(system: System | Lagrangian) -> diffrax.AbstractSolver:
    """The solver that `simulate` takes when none is given; `sol.stats["why"]` says why.

    A symplectic one of fixed steps where the scene can be cut into exact flows: `BlanesMoan6` for uniform strain, rigid
    and driven rods, `ABA864` for more strain shapes.  Else, as where forces depend on rates, the adaptive `Dopri8`.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> for basis in (jaxrod.Ritz(1), jaxrod.Ritz(3), jaxrod.QuasiStatic(jaxrod.Ritz(1))):
    ...     print(type(jaxrod.default_solver(jaxrod.System(rod, jaxrod.Rotation(), basis))).__name__)
    BlanesMoan6
    ABA864
    Dopri8
    """
    return best_solver(system)[0] if isinstance(system, System) else diffrax.Dopri8()


def default_chart(system: Any) -> AbstractChart:
    """The coordinates that `simulate` takes when none are given.

    Where the rotation is driven the strain alone.  In the plane the angle, which has no pole and counts its turns.  In
    space the embedded q = (1 + eps) d where the strain is uniform, else the director.  In float32 always the director
    beside the strain: an angle of many turns and a strain kept as 1 + eps would lose their last digits to rounding.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.default_chart(jaxrod.System(rod, jaxrod.Spherical())))
    Embedded()
    """
    if isinstance(system.motion, Driven):
        return Strains()
    if checks.float_type(system) == jnp.float32:
        return Director()
    if system.motion.dimension == 2:
        return Angles()
    return Embedded() if system.flat else Director()


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
    budget: AbstractQuantity | Callable | None = None,
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
      more runs: `sol.budget`.
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
    if isinstance(tolerance, Plan):
        return _follow(
            tolerance, system, start, t0=t0, ts=ts, t1=t1, chart=chart, solver=solver, dt0=dt0, n_steps=n_steps,
            stepsize_controller=stepsize_controller, saveat=saveat, event=event, adjoint=adjoint,
            progress_meter=progress_meter, max_steps=max_steps, budget=budget, throw=throw,
        )  # fmt: skip
    if not isinstance(system, System | Lagrangian):
        raise ValueError(f"system={system!r} cannot be simulated; give a System, or Lagrangian(function of t, q, v).")
    if isinstance(system, System) != isinstance(start, State):
        needed = "a state, made by system.state(angle=..., rate=...)" if isinstance(system, System) else "a pair (q, v)"
        raise ValueError(f"start={start!r} does not fit; this system starts from {needed}.")
    dtype = checks.float_type(system, start)
    system, start = in_type(dtype, (system, start))
    if chart is not None and not (isinstance(chart, AbstractChart) and isinstance(system, System)):
        raise ValueError(
            f"chart={chart!r} does not fit; give a System Angles(), Embedded() or Director(), a Lagrangian none."
        )
    if isinstance(system, System) and isinstance(start, State):
        check_start(system.motion, system.basis.n, start)
    else:
        start = Phase(*(jnp.asarray(x, dtype) for x in start))

    t0, t1, ts = _times(ts, t1, t0, saveat, dtype)
    if adjoint is not None and not isinstance(adjoint, diffrax.AbstractAdjoint | Reversible):
        raise ValueError(f"adjoint={adjoint!r} is no adjoint; give an instance, such as diffrax.ForwardMode().")
    if not (isinstance(max_steps, int) and max_steps > 0):
        raise ValueError(f"max_steps={max_steps!r} must be a positive whole number.")
    step_keywords = {"solver": solver, "stepsize_controller": stepsize_controller, "dt0": dt0, "n_steps": n_steps}
    given = [name for name, value in step_keywords.items() if value is not None]
    if tolerance is not None and given:
        raise ValueError(f"tolerance={tolerance} chooses solver and steps itself; leave out {', '.join(given)}.")
    asked = _checked_tolerance(tolerance, dtype)

    def adapt(solver, why, longest=None):
        atol = jnp.maximum(_LOCAL * asked, _LEAST_LOCAL[asked.dtype.name])
        fitting = None if isinstance(solver, AbstractSymplectic) else chart
        if isinstance(system, System) and fitting is None and not isinstance(solver, AbstractSymplectic):
            fitting = default_chart(system)
        if isinstance(system, System) and fitting is not None:
            system.check_chart(fitting)
        return _explained(
            integrate(
                system, start, fitting, t0, t1, ts, atol, solver, stepsize_controller, dt0, n_steps, saveat, event,
                diffrax.RecursiveCheckpointAdjoint() if adjoint is None or isinstance(adjoint, Reversible) else adjoint,
                diffrax.NoProgressMeter() if progress_meter is None else progress_meter,
                max_steps, longest,
            ),
            why,
        )  # fmt: skip

    # Equal steps from save time to save time need nothing of Diffrax; what does goes through Diffrax.
    plain = all(x is None for x in (stepsize_controller, dt0, saveat, event, progress_meter))
    plain = plain and (adjoint is None or isinstance(adjoint, Reversible | diffrax.ForwardMode))
    # A number that hides in a closure has no reverse derivative through steps that are undone.
    hidden = isinstance(system, System) and checks.closes_over_traced((system.forces, system.motion))
    hidden = hidden and not isinstance(adjoint, diffrax.ForwardMode)
    plain = plain and not hidden
    best, why = (
        best_solver(system) if isinstance(system, System) else (diffrax.Dopri8(), "adaptive, for any Lagrangian")
    )
    if solver is None and not (plain and chart is None):
        best, why = diffrax.Dopri8(), "adaptive, as a chart, steps, saveat, event, adjoint or meter was given"
        if hidden:
            why = "adaptive, as a function of the scene closes over a traced number; hold it in an eqx.Module"
    chosen, why = (best, why) if solver is None else (solver, "as given")
    _check_steps(chosen, stepsize_controller, dt0, n_steps, plain)
    if isinstance(chosen, AbstractSymplectic):
        _check_split(system, chosen, chart)
    elif isinstance(adjoint, Reversible):
        raise ValueError(f"adjoint=Reversible() runs symplectic solvers backwards, not {type(chosen).__name__}.")
    if isinstance(chosen, AbstractMultistep):
        _check_multistep(system, chosen, plain and chart is None)
    unrolled = isinstance(chosen, Unrolled) and isinstance(system, System) and chart is None
    by_equal_steps = plain and (isinstance(chosen, AbstractSymplectic | AbstractMultistep) or unrolled)
    if n_steps is not None and not by_equal_steps and not checks.known(n_steps):
        raise ValueError("n_steps= is traced, which only symplectic solvers and Unrolled() take; give a known number.")
    if by_equal_steps:
        solution = _explained(_step(system, start, t0, t1, ts, chosen, n_steps, tolerance, max_steps, adjoint), why)
        failed = checks.fails(lambda ok: ok, solution.ok)
        if solver is None and n_steps is None and failed and not bool(solution.result == Result.invalid):
            # Steps that adapt may pass over a load that equal ones met: they are to look as closely.
            longest = None if isinstance(system, System) and is_closed(system) else solution.stats["step"] / _CLOSER
            why = f"adaptive, as equal steps ended with: {Result[solution.result]}"
            solution = adapt(diffrax.Dopri8(), why, longest)
    else:
        solution = adapt(chosen, why)
    if throw and checks.known(solution.stats["num_steps"]) and checks.fails(lambda ok: ok, solution.ok):
        raise SimulationError(solution.complaint(), solution)
    if budget is not None:
        if not isinstance(system, System) or not isinstance(start, State):
            raise ValueError(f"budget={budget!r} is of a System; of any Lagrangian compare runs of two tolerances.")

        times = {"t1": t1, "saveat": saveat} if ts is None else {"ts": ts}
        same = {"t0": t0, **times, "event": event, "adjoint": adjoint, "max_steps": max_steps, "throw": False}

        def again(system, start, least=None):
            steps = {"tolerance": tolerance, "chart": chart, **step_keywords} if least is None else {"tolerance": least}
            return simulate(system, start, **same, **steps)

        quantity = as_quantity(budget)
        solution = dataclasses.replace(solution, budget=budget_of(quantity, system, start, solution, again))
    return solution


def _follow(plan: Plan, system, start, *, solver, n_steps, stepsize_controller, dt0, chart, **others) -> Solution:
    """A run as planned."""
    own = {"solver": solver, "n_steps": n_steps, "stepsize_controller": stepsize_controller, "dt0": dt0, "chart": chart}
    given = [name for name, value in own.items() if value is not None]
    if given:
        raise ValueError(f"tolerance= is a plan, which chooses them itself; leave out {', '.join(given)}.")
    system, start = plan.applied(system, start)
    end = others["t1"] if others["ts"] is None else others["ts"][-1]
    return simulate(system, start, **plan.steps(system, start, others["t0"], end), **others)


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


def _explained(solution: Solution, why: str) -> Solution:
    return dataclasses.replace(solution, stats={**solution.stats, "why": Reason(why)})


def _step(system, start, t0, t1, ts, solver, n_steps, tolerance, max_steps, adjoint) -> Solution:
    if tolerance is None:
        tolerance = _DEFAULT_TOLERANCE[jnp.dtype(t0.dtype).name]
    ends = t1[None] if ts is None else ts
    even = ends.size == 1 or _even(t0, ends)
    forwards = isinstance(adjoint, diffrax.ForwardMode)
    backwards = isinstance(solver, AbstractSymplectic) and not forwards
    tolerance = jnp.asarray(tolerance, t0.dtype)
    n_steps = None if n_steps is None else jnp.asarray(n_steps, t0.dtype)  # so that another count is the same program
    solution = step_through(
        system, start, t0, ends, solver, n_steps, tolerance, even, ts is None, max_steps, backwards
    )  # fmt: skip
    if isinstance(solver, AbstractMultistep) and not forwards:
        why = f"solver={type(solver).__name__}() has no reverse derivative; take BlanesMoan6(), or adjoint=diffrax.ForwardMode()."
        solution = dataclasses.replace(solution, states=irreversible(solution.states, why))
    return solution


def _even(t0, ts) -> bool:
    """Whether save times are known to be equally spaced, from t0 or from the first."""
    if not (checks.known(t0) and checks.known(ts)):
        return False
    legs = np.diff(np.asarray(ts), prepend=np.asarray(t0))
    legs = legs[1:] if legs[0] == 0 else legs
    return bool(np.ptp(legs) <= 1e-9 * np.abs(np.asarray(ts)).max()) if ts.dtype == np.float64 else False


def _check_split(system: Any, solver: AbstractSymplectic, chart: AbstractChart | None) -> None:
    name = type(solver).__name__
    if not isinstance(system, System) or system.unsplit:
        why = system.unsplit if isinstance(system, System) else "it is any Lagrangian"
        raise ValueError(f"solver={name}() cannot step this scene: {why}; take solver=diffrax.Dopri8().")
    if chart is not None:
        raise ValueError(f"solver={name}() has coordinates of its own; leave out chart={chart!r}.")
    if solver.needs_nystrom and system.basis.n and not (system.splits_flat or isinstance(system.motion, Driven)):
        raise ValueError(
            f"solver={name}() keeps its order for uniform strain, rigid and driven rods alone; take ABA864() or BlanesMoan4()."
        )


def _check_multistep(system: Any, solver: AbstractMultistep, alone: bool) -> None:
    name = type(solver).__name__
    free = isinstance(system, System) and not isinstance(system.motion, Driven)
    if not (free and system.splits_flat) or system.unsplit:
        raise ValueError(
            f"solver={name}() is for uniform strain (Ritz(1)) in float64 that moves freely, without forces that depend on rates; "
            "take ABA864(), or leave out solver=."
        )
    if not alone:
        raise ValueError(
            f"solver={name}() goes by equal steps alone; leave out chart=, saveat=, event=, adjoint= and progress_meter=."
        )


def _times(ts, t1, t0, saveat, dtype) -> tuple[Array, Array, Array | None]:
    if (ts is None) == (t1 is None):
        given = "neither" if ts is None else "both"
        raise ValueError(f"{given} of ts= and t1= given; give ts= (times to save at) or t1= (the end alone).")
    if saveat is not None and (ts is not None or saveat.dense or not isinstance(saveat.subs, diffrax.SubSaveAt)):
        raise ValueError(
            "saveat= goes with t1=, without dense= and subs=; give SaveAt(ts=...), SaveAt(steps=True), or ts=."
        )
    t0 = checks.number("t0", t0).astype(dtype)
    inner = None if saveat is None else saveat.subs.ts
    if inner is not None and checks.fails(lambda ts, t0, t1: (ts >= t0) & (ts <= t1), inner, t0, t1):
        raise ValueError(f"saveat.ts={checks.shown(inner)} must lie between t0={checks.shown(t0)} and t1={t1}.")
    if ts is None:
        t1 = checks.number("t1", t1).astype(dtype)
        if checks.fails(np.greater, t1, t0):
            raise ValueError(f"t1={checks.shown(t1)} does not lie after t0={checks.shown(t0)}; give a later t1=.")
        return t0, t1, None
    ts = checks.numbers("ts", ts, "times in s").astype(dtype)
    if checks.fails(lambda ts: np.diff(ts) > 0, ts):
        first = int(np.argmin(np.diff(ts) > 0))
        raise ValueError(
            f"ts must increase, but ts[{first}]={ts[first]:.6g} is followed by {ts[first + 1]:.6g}; sort it and drop doubles."
        )
    if checks.fails(lambda ts, t0: (ts[0] >= t0) & (ts[-1] > t0), ts, t0):
        raise ValueError(
            f"ts={checks.shown(ts)} does not lie after the start t0={checks.shown(t0)}; give later times, or t0=."
        )
    return t0, ts[-1], ts


def _checked_tolerance(tolerance, dtype) -> Float[Array, ""]:
    name = jnp.dtype(dtype).name
    if tolerance is None:
        tolerance = _DEFAULT_TOLERANCE[name]
    tolerance = checks.positive("tolerance", tolerance, "relative error of the tip's position")
    if checks.fails(lambda tolerance: tolerance >= LEAST_TOLERANCE[name], tolerance):
        other = "call jaxrod.configure() and build the scene in float64" if name == "float32" else "take a larger one"
        raise ValueError(
            f"tolerance={checks.shown(tolerance)} is beyond {name}, which reaches {LEAST_TOLERANCE[name]:.0e}; {other}."
        )
    return tolerance.astype(dtype)


def _check_steps(solver, stepsize_controller, dt0, n_steps, plain: bool) -> None:
    if not isinstance(solver, diffrax.AbstractSolver | AbstractMultistep):
        raise ValueError(f"solver={solver!r} is not a solver; give an instance, such as diffrax.Tsit5().")
    if dt0 is not None:
        checks.positive("dt0", dt0, "seconds")
    if n_steps is not None:
        checks.number("n_steps", n_steps)
        if checks.fails(lambda n: (n >= 1) & (n == np.floor(n)), n_steps):
            raise ValueError(f"n_steps={n_steps} must be a positive whole number.")
        if dt0 is not None or stepsize_controller is not None:
            raise ValueError(f"n_steps={n_steps} fixes the steps; leave out dt0= and stepsize_controller=.")
    elif isinstance(solver, BlanesMoan6 | ABA864) and plain:
        return  # steps are counted by the tolerance
    elif dt0 is None and stepsize_controller is None and not isinstance(solver, diffrax.AbstractAdaptiveSolver):
        raise ValueError(f"solver={type(solver).__name__}() estimates no error to adapt steps by; give n_steps=.")
