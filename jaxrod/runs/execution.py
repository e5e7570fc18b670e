"""One run, from what is asked to a `Solution`: `Request.checked` refuses what makes no sense, `execute` runs the rest.

How a run ended is a code in what `execute` returns: it raises nothing but that a run has no such derivative.
"""

import dataclasses
import warnings
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import precision, tracing, validation
from ..core.result import Result
from ..integrators.multistep import AbstractMultistep
from ..integrators.runge_kutta import Unrolled
from ..integrators.symplectic import AbstractSymplectic
from ..mechanics.chart import AbstractChart
from ..mechanics.lagrangian import Lagrangian, Phase
from ..mechanics.system import System
from ..motions.state import check_start
from . import arguments
from .adaptive_steps import by_the_clock, integrate
from .arguments import Times
from .defaults import best_solver, by_equal_steps, default_chart
from .fixed_steps import step_through
from .invariants import is_closed
from .solution import Solution
from .step_policy import StepPolicy

SELDOM = 2e5  # steps, below which the few runs of a program are over sooner than it is optimised
_LOCAL = 1e-4  # error of a step over `tolerance`
_CLOSER = 8  # steps in one that was too long for a load
_LEAST_LOCAL = {"float64": 7e-15, "float32": 3e-8}  # below it rounding is all that the error estimate sees


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


@dataclasses.dataclass(frozen=True)
class Request:
    """A run as it was asked for, every argument checked: of `simulate`, but for what it does with the solution.

    `scene` is `system` on a clock that shows zero when the run begins; `chosen`, the solver, and `why`; `equal`, whether it
    goes by equal steps in one loop, and not through Diffrax; `unknown`, whether it leaves a `Record` (None: it does not);
    `seldom`, whether its program is to run a few times.
    """

    system: System | Lagrangian
    scene: Any  # System | Lagrangian
    start: Any  # State | Phase
    times: Times
    ts: Any
    tolerance: Float[Array, ""]
    chart: AbstractChart | None
    solver: Any
    chosen: Any
    why: str
    equal: bool
    stepsize_controller: diffrax.AbstractStepSizeController | None
    dt0: Any
    n_steps: Any
    saveat: diffrax.SaveAt | None
    event: diffrax.Event | None
    adjoint: Any
    progress_meter: diffrax.AbstractProgressMeter | None
    max_steps: int
    knots: Float[Array, " K"] | None
    unknown: Bool[Array, ""] | None
    seldom: bool

    @staticmethod
    def checked(
        system: Any,
        start: Any,
        *,
        ts: Any = None,
        t1: Any = None,
        t0: Any = 0.0,
        tolerance: Any = None,
        chart: Any = None,
        solver: Any = None,
        stepsize_controller: Any = None,
        dt0: Any = None,
        n_steps: Any = None,
        saveat: Any = None,
        event: Any = None,
        adjoint: Any = None,
        progress_meter: Any = None,
        max_steps: Any = 2**20,
        seldom: bool = False,
    ) -> "Request":
        """**Raises:** `ValueError` for arguments that make no sense; they are those of `simulate`."""
        arguments.check_scene(system, start, chart)
        dtype = precision.float_type(system, start)
        precision.warn_if_lowered(dtype, system, start, stacklevel=4)
        system, start = precision.in_type(dtype, (system, start))
        if isinstance(system, System):
            check_start(system.motion, system.basis.n, start)
        else:
            start = Phase(*(jnp.asarray(x, dtype) for x in start))
        arguments.check_run(start, saveat, event, progress_meter, stepsize_controller)
        times = arguments.times(ts, t1, t0, saveat, dtype, by_the_clock=stepsize_controller is not None)
        if adjoint is not None and not isinstance(adjoint, diffrax.AbstractAdjoint | Reversible):
            raise ValueError(
                f"adjoint={validation.given(adjoint)} is no adjoint; give an instance, such as diffrax.ForwardMode()."
            )
        max_steps = validation.count("max_steps", max_steps, 1, "steps")
        steps = {"solver": solver, "stepsize_controller": stepsize_controller, "dt0": dt0, "n_steps": n_steps}
        given = [name for name, value in steps.items() if value is not None]
        if tolerance is not None and given:
            raise ValueError(
                f"tolerance={validation.brief(tolerance)} chooses solver and steps itself; leave out {', '.join(given)}."
            )
        tolerance = arguments.checked_tolerance(tolerance, dtype, (system, start))

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
        if chart is not None:
            system.check_chart(chart)
        if isinstance(chosen, AbstractMultistep):
            arguments.check_multistep(system, chosen, plain and chart is None)
        unrolled = isinstance(chosen, Unrolled) and isinstance(system, System) and chart is None
        equal = plain and (by_equal_steps(chosen) or unrolled)
        if n_steps is not None and not equal and not tracing.known(n_steps):
            raise ValueError(
                "n_steps= is traced, which only symplectic solvers and Unrolled() take; give a known number."
            )
        knots, unknown = arguments.knots(system, times, equal, stepsize_controller, n_steps)
        scene = system if times.clock is None else system.delayed(times.clock.astype(dtype))
        return Request(
            system, scene, start, times, ts, tolerance, chart, solver, chosen, why, equal, stepsize_controller, dt0, n_steps,
            saveat, event, adjoint, progress_meter, max_steps, knots, unknown, seldom,
        )  # fmt: skip


def solve(system: Any, start: Any, **asked: Any) -> Solution:
    """A run as asked, by the keywords of `Request.checked`."""
    return execute(Request.checked(system, start, **asked))


def execute(request: Request, policy: StepPolicy | None = None) -> Solution:
    """The run; where the default's equal steps were too long for it, once more by steps that adapt."""
    if not request.equal:
        return _as_asked(request, _through_diffrax(request, request.chosen, request.why))
    solution = _explained(_by_equal_steps(request, StepPolicy() if policy is None else policy), request.why)
    failed = validation.fails(lambda ok: ok, solution.ok) and not bool(solution.result == Result.invalid)
    if request.solver is None and request.n_steps is None and failed:
        # Steps that adapt may pass over a load that equal ones met: they are to look as closely.
        closed = isinstance(request.system, System) and is_closed(request.system)
        longest = None if closed else solution.stats["step"] / _CLOSER
        why = f"adaptive, as equal steps ended with: {Result[solution.result]}"
        solution = _through_diffrax(request, diffrax.Dopri8(), why, longest)
    return _as_asked(request, solution)


def _chosen(system: Any, solver: Any, plain: bool, hidden: bool) -> tuple[Any, str]:
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


def _by_equal_steps(request: Request, policy: StepPolicy) -> Solution:
    times, solver, n_steps = request.times, request.chosen, request.n_steps
    t0, ts = times.start, times.saved
    ends = times.end[None] if ts is None else ts
    forwards = isinstance(request.adjoint, diffrax.ForwardMode)
    solution = step_through(
        request.scene,
        request.start,
        t0,
        ends,
        solver,
        None if n_steps is None else jnp.asarray(n_steps, t0.dtype),  # so that another count is the same program
        request.tolerance,
        even=ends.size == 1 or _even(t0, ends, times.clock),
        end_only=ts is None,
        max_steps=request.max_steps,
        backwards=by_equal_steps(solver) and not forwards,
        knots=request.knots,
        policy=policy,
        seldom=request.seldom,
    )
    return solution


def _through_diffrax(request: Request, solver: Any, why: str, longest: Any = None) -> Solution:
    """The run by Diffrax, with steps of `longest` s at most."""
    scene, times, adjoint, chart = request.scene, request.times, request.adjoint, request.chart
    if isinstance(solver, AbstractSymplectic) or not isinstance(scene, System):
        chart = None  # these have coordinates of their own
    elif chart is None:
        chart = default_chart(scene)
    saveat, event = by_the_clock(times, request.saveat, request.event)
    solution = integrate(
        scene,
        request.start,
        chart,
        times.start,
        times.end,
        ts=times.saved,
        atol=jnp.maximum(_LOCAL * request.tolerance, _LEAST_LOCAL[request.tolerance.dtype.name]),
        solver=solver,
        controller=request.stepsize_controller,
        dt0=request.dt0,
        n_steps=request.n_steps,
        saveat=saveat,
        event=event,
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None or isinstance(adjoint, Reversible) else adjoint,
        progress_meter=diffrax.NoProgressMeter() if request.progress_meter is None else request.progress_meter,
        max_steps=request.max_steps,
        longest=longest,
        knots=request.knots,
        seldom=request.seldom,
    )
    return _explained(solution, why)


@jax.tree_util.register_pytree_node_class
class _Reason(str):
    """A sentence that travels through transformations."""

    def tree_flatten(self):
        return (), str(self)

    @classmethod
    def tree_unflatten(cls, sentence, _):
        return cls(sentence)


def _explained(solution: Solution, why: str) -> Solution:
    return dataclasses.replace(solution, stats={**solution.stats, "why": _Reason(why)})


def _even(t0, ts, clock) -> bool:
    """Whether save times are known to be equally spaced, from t0 or from the first, to the rounding of their stamps."""
    if ts.dtype != np.float64 or not all(map(tracing.known, (t0, ts, 0.0 if clock is None else clock))):
        return False
    ts = np.asarray(ts)
    ts = ts if ts[0] == t0 else np.concatenate([[t0], ts])
    off = np.abs(ts - np.linspace(ts[0], ts[-1], ts.size)).max()
    stamp = max(abs(ts[-1]), 0.0 if clock is None else abs(float(clock)) + ts[-1])
    return bool(off <= max(1e-9 * (ts[-1] - ts[0]) / ts.size, 4 * np.spacing(stamp)))


def _as_asked(request: Request, solution: Solution) -> Solution:
    """The solution on the user's clock, of the scene as it was given, with what its loads let one know."""
    times, ts = request.times, request.ts
    if times.clock is not None:
        stamps = times.clock + solution.ts.astype(times.clock.dtype)
        if ts is not None:  # as they were given, to the last digit
            stamps = jnp.where(jnp.isfinite(stamps), jnp.asarray(ts, stamps.dtype), jnp.nan)
        stats = {**solution.stats, "t_end": times.clock + solution.stats["t_end"].astype(times.clock.dtype)}
        solution = dataclasses.replace(solution, ts=stamps, stats=stats, system=request.system)
    stats = dict(solution.stats)
    unseen, code = stats.pop("unseen", None), solution.result
    if unseen is not None and not tracing.known(unseen):
        code = Result.where((code == Result.ok) & unseen, Result.unseen, code)
    elif unseen is not None and validation.fails(lambda unseen: ~unseen, unseen):
        warnings.warn(Result.unseen.sentence, stacklevel=4)
    if request.unknown is not None:
        lost = jnp.where(request.unknown, jnp.nan, 1.0)
        states = jax.tree.map(lambda x: x * lost.astype(x.dtype), solution.states)
        code = Result.where(request.unknown, Result.invalid, code)
        solution = dataclasses.replace(solution, states=states)
    return dataclasses.replace(solution, result=code, stats=stats)
