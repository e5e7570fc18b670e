"""`simulate`: from a scene and a start to a `Solution`.  How it is stepped is decided in `runs`.

**Accuracy.**  `tolerance` is the relative error of the tip's position after 1,000 axial periods.

- By default a run takes equal steps.  `runs.fixed_steps.step_size` decides how long they are: by the tolerance, by how fast
  the scene moves (`Scales`), and by the numbers of `StepPolicy`.  Energy is kept to a part of the tolerance (`open_energy`).
- Where a scene has no split (`System.unsplit`: forces that depend on rates, for one), and where equal steps were too long, steps
  adapt.  Errors of single steps are measured in natural units (radians and strains for coordinates; rates over the natural rate
  of the scene) and held 10^4 times below the tolerance: about ten steps a period, 1,000 periods.  Energy is kept to the tolerance
  alone: damping weaker than that, of a quality beyond 1e9, is not seen in it.
- In float32 the rounding of the turning itself comes on top, 6e-7 for each radian turned; after a hundred turns, as the rounding
  of the energy adds up, up to five times that.
"""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from . import configuration
from .accuracy.error_budget import budgets
from .accuracy.quantity import AbstractQuantity, as_quantity
from .accuracy.run_plan import Plan
from .core import progress, tracing, units, validation
from .core.result import SimulationError
from .core.units import Number, Row
from .integrators.multistep import AbstractMultistep
from .mechanics.chart import AbstractChart
from .mechanics.lagrangian import Lagrangian
from .mechanics.system import System
from .motions.state import State
from .rods import plausibility
from .rods.rod import Rod
from .runs import arguments
from .runs.execution import Request, Reversible, execute, solve
from .runs.solution import Solution


def simulate(
    system: System | Lagrangian,
    start: State | tuple[Array, Array],
    *,
    ts: Row | None = None,
    t1: Number | None = None,
    t0: Number = 0.0,
    tolerance: Number | None = None,
    chart: AbstractChart | None = None,
    solver: diffrax.AbstractSolver | AbstractMultistep | None = None,
    stepsize_controller: diffrax.AbstractStepSizeController | None = None,
    dt0: Number | None = None,
    n_steps: Number | None = None,
    saveat: diffrax.SaveAt | None = None,
    event: diffrax.Event | None = None,
    adjoint: diffrax.AbstractAdjoint | Reversible | None = None,
    progress_meter: diffrax.AbstractProgressMeter | None = None,
    max_steps: int = 2**20,
    plan: Plan | None = None,
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
      1e-4 in float32 (at least 1e-5).
    - `plan`: what `jaxrod.plan` has found, to follow it: its rung, solver, steps, float type.
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
    asked = {name: units.in_unit(name, time, "s") for name, time in in_s.items()} | {
        "tolerance": tolerance, "chart": chart, "solver": solver, "n_steps": n_steps,
        "stepsize_controller": stepsize_controller, "saveat": saveat, "event": event, "adjoint": adjoint,
        "progress_meter": progress_meter, "max_steps": max_steps,
    }  # fmt: skip
    validation.switch("throw", throw)
    configuration.remind_once()
    if plan is not None or isinstance(tolerance, Plan):
        system, start, asked = _planned(plan, system, start, asked)
    request = Request.checked(system, start, **asked)
    quantities = _quantities(budget, request.system)

    with progress.line("simulate"):
        solution = execute(request)

    if throw and tracing.known(solution.stats["num_steps"]) and validation.fails(lambda ok: ok, solution.ok):
        raise SimulationError(solution.complaint(), solution)
    _doubt_strain(solution)

    if quantities:
        with progress.line("budget"):
            found = _budgets(quantities, request, solution, asked)
        solution = dataclasses.replace(solution, budget=found if isinstance(budget, list | tuple) else found[0])
    return solution


def _planned(plan: Any, system: Any, start: Any, asked: dict[str, Any]) -> tuple[System, State, dict[str, Any]]:
    """The scene on a plan's rung, its start, and what is asked of its run."""
    if isinstance(asked["tolerance"], Plan):
        warnings.warn("simulate(tolerance=plan) is written simulate(plan=plan) now.", FutureWarning, stacklevel=3)
        plan, asked["tolerance"] = (asked["tolerance"], None) if plan is None else (plan, asked["tolerance"])
    if not isinstance(plan, Plan):
        raise ValueError(f"plan={validation.given(plan)} is no plan; give what jaxrod.plan has found.")
    own = ("tolerance", "solver", "n_steps", "stepsize_controller", "dt0", "chart")
    given = [name for name in own if asked[name] is not None]
    if given:
        raise ValueError(f"plan= chooses them itself; leave out {', '.join(given)}.")
    arguments.check_scene(system, start)
    times = arguments.times(asked["ts"], asked["t1"], asked["t0"], asked["saveat"], jnp.result_type(float))
    system, start = plan.applied(system, start, asked["t0"])
    return system, start, {**asked, **plan.steps(system, start, times.start, times.end)}


def _quantities(budget: Any, system: System | Lagrangian) -> list[AbstractQuantity]:
    """What the error is asked of."""
    if budget is None:
        return []
    several = isinstance(budget, list | tuple)
    if several and (not budget or any(each is None for each in budget)):
        raise ValueError(
            f"budget={validation.given(budget)} asks for nothing; give a quantity, such as FinalTip(), or leave it out."
        )
    if isinstance(system, Lagrangian):
        raise ValueError(
            f"budget={validation.given(budget)} is of a System; of any Lagrangian compare runs of two tolerances."
        )
    return [as_quantity(each) for each in (budget if several else [budget])]


def _budgets(quantities: list[AbstractQuantity], request: Request, solution: Solution, asked: dict[str, Any]) -> tuple:
    """The errors, by runs like this one and by closer ones."""
    system, start = request.system, request.start
    assert isinstance(system, System) and isinstance(start, State)
    if not isinstance(solution.states, State):
        asking = ", ".join(quantity.name for quantity in quantities)
        raise ValueError(f"budget= of {asking} asks whole states; leave out fn= of saveat=.")
    t0, t1 = (asked[name] for name in ("t0", "t1"))
    saved = {"t0": t0, "ts": asked["ts"], "t1": t1, "saveat": asked["saveat"]}
    same = {"event": asked["event"], "adjoint": asked["adjoint"], "max_steps": asked["max_steps"]}
    steps = ("tolerance", "chart", "solver", "stepsize_controller", "dt0", "n_steps")

    def again(system, start, least=None, times=None, seldom=False):
        how = {name: asked[name] for name in steps} if least is None else {"tolerance": least}
        return solve(
            system, start, **(saved if times is None else {"t0": t0, "ts": times}), **same, **how, seldom=seldom
        )

    def own_times(quantity):  # a run of its own for what looks at more than the end that is saved
        looked = quantity.times(t0, t1) if asked["ts"] is None and asked["saveat"] is None else None
        return looked if looked is not None and looked.size > 1 else None

    return budgets(quantities, system, start, solution, again, own_times)


def _doubt_strain(solution: Solution) -> None:
    """Warn of a run that is known to have stretched a rod beyond all that Hooke's law is for."""
    rod: Any = getattr(solution.system, "rod", None)
    states = solution.states
    hooke = isinstance(rod, Rod) and rod.linear and isinstance(states, State)
    if not hooke or not tracing.known(states.amplitudes) or validation.fails(lambda ok: ok, solution.ok):
        return
    largest = np.max(np.abs(np.asarray(states.amplitudes)[..., :1]), initial=0.0)
    if doubt := plausibility.strain(float(largest), validation.brief(rod.young)):
        warnings.warn(doubt, stacklevel=3)
