"""What `simulate` is given, looked at before anything runs."""

from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import configuration
from ..core import calling, precision, tracing, units, validation
from ..integrators.multistep import AbstractMultistep
from ..integrators.symplectic import ABA864, AbstractSymplectic, BlanesMoan6
from ..mechanics.chart import AbstractChart
from ..mechanics.lagrangian import Lagrangian
from ..mechanics.system import System, check_system
from ..motions.state import State, check_start
from ..motions.stops import known_knots, since
from ..rods.rod import Rod
from .fixed_steps import LEAST_TOLERANCE

_DEFAULT_TOLERANCE = {"float64": 1e-8, "float32": 1e-4}


def check_scene(system: Any, start: Any, chart: Any = None) -> None:
    if not isinstance(system, System | Lagrangian):
        raise ValueError(
            f"system={validation.given(system)} cannot be simulated; give a System, or Lagrangian(function of t, q, v)."
        )
    pair = isinstance(start, tuple | list) and len(start) == 2
    if not (isinstance(start, State) if isinstance(system, System) else pair):
        needed = "a state, made by system.state(angle=..., rate=...)" if isinstance(system, System) else "a pair (q, v)"
        raise ValueError(
            f"start={validation.given(start)} does not fit; this system starts from {needed}, so give that."
        )
    if isinstance(system, Lagrangian):
        system.check(calling.like(), *start)
    if chart is not None and not (isinstance(chart, AbstractChart) and isinstance(system, System)):
        raise ValueError(
            f"chart={validation.given(chart)} does not fit; give a System Angles(), Embedded() or Director(), a Lagrangian none."
        )


def check_run(start: Any, saveat: Any, event: Any, progress_meter: Any, stepsize_controller: Any) -> None:
    """What `simulate` hands on to Diffrax; functions in it are tried on the start."""
    for name, value, kind, example in (
        ("saveat", saveat, diffrax.SaveAt, "diffrax.SaveAt(t1=True)"),
        ("event", event, diffrax.Event, "diffrax.Event(lambda t, state, args, **_: state.angle)"),
        ("progress_meter", progress_meter, diffrax.AbstractProgressMeter, "diffrax.TqdmProgressMeter()"),
        ("stepsize_controller", stepsize_controller, diffrax.AbstractStepSizeController, "diffrax.ConstantStepSize()"),
    ):
        if value is not None and not isinstance(value, kind):
            raise ValueError(f"{name}={validation.given(value)} does not fit; give an instance, such as {example}.")
    t = calling.like()
    if saveat is not None and isinstance(saveat.subs, diffrax.SubSaveAt):
        wanted = "(t, state, args) -> arrays"
        calling.rehearsed(
            lambda t, state: calling.arrays("saveat.fn", wanted, saveat.subs.fn, t, state, None), t, start
        )
    if event is not None:
        others = dict.fromkeys(("terms", "solver", "t0", "t1", "dt0", "saveat", "stepsize_controller", "max_steps"))
        for condition in jax.tree.leaves(event.cond_fn, is_leaf=callable):
            if not callable(condition):
                raise ValueError(
                    f"event={validation.given(condition)} is not a condition; give diffrax.Event(function)."
                )
            checked = jax.tree_util.Partial(condition, **others)
            calling.tried("event", "(t, state, args, **kwargs) -> one number", checked, t, start, None, shapes=[()])


def check_system_and_start(system: Any, start: Any) -> None:
    """A `System`, no other `Lagrangian`, and a start of it."""
    check_system(system)
    check_scene(system, start)
    check_start(system.motion, system.basis.n, start)


def check_known(system: Any, start: Any, instead: str, static: Any) -> None:
    """What is run in many ways, and with float64 beside: a scene whose numbers are there."""
    check_system_and_start(system, start)
    if not all(map(tracing.known, jax.tree.leaves((system, start)))):
        raise ValueError(f"the scene is traced; {instead}.")
    if jnp.result_type(float) != jnp.float64:
        raise ValueError(f"the exact rod needs float64: {configuration.remedy_of_float32()}.")
    validation.switch("static", static)
    if static and isinstance(system.rod, Rod) and not system.rod.linear:
        raise ValueError(
            f"static=True is of Hooke's law; give start its strain (jaxrod.equilibrium), or leave out law={system.rod.law_name}."
        )


def check_split(system: Any, solver: AbstractSymplectic, chart: AbstractChart | None) -> None:
    name = type(solver).__name__
    if not isinstance(system, System) or system.unsplit:
        why = system.unsplit if isinstance(system, System) else "it is any Lagrangian"
        raise ValueError(f"solver={name}() cannot step this scene: {why}; take solver=diffrax.Dopri8().")
    if chart is not None:
        raise ValueError(f"solver={name}() has coordinates of its own; leave out chart={validation.given(chart)}.")
    if solver.needs_nystrom and system.basis.n and not (system.splits_flat or system.motion.prescribed):
        raise ValueError(
            f"solver={name}() keeps its order for uniform strain, rigid and driven rods alone; take ABA864() or BlanesMoan4()."
        )


def check_multistep(system: Any, solver: AbstractMultistep, alone: bool) -> None:
    name = type(solver).__name__
    free = isinstance(system, System) and not system.motion.prescribed
    if not (free and system.splits_flat) or system.unsplit:
        raise ValueError(
            f"solver={name}() is for uniform strain (Ritz(1)) in float64 that moves freely, without forces that depend on rates; "
            "take ABA864(), or leave out solver=."
        )
    if not alone:
        raise ValueError(
            f"solver={name}() goes by equal steps alone; leave out chart=, saveat=, event=, adjoint= and progress_meter=."
        )


class Times(NamedTuple):
    """A run's times in s: from `start` to `end`, saving at `saved` (T,); all since `clock`, if there is one."""

    clock: Float[Array, ""] | None
    start: Float[Array, ""]
    end: Float[Array, ""]
    saved: Float[Array, " T"] | None


def times(ts, t1, t0, saveat, dtype, by_the_clock: bool = False) -> Times:
    """The times of a run since its begin: stamps far from zero would cost all in it their digits.

    `by_the_clock`: as they are, for what knows the user's times.
    """
    t0, t1, ts = (units.in_unit(name, x, "s") for name, x in {"t0": t0, "t1": t1, "ts": ts}.items())
    if (ts is None) == (t1 is None):
        given = "neither" if ts is None else "both"
        raise ValueError(f"{given} of ts= and t1= given; give ts= (times to save at) or t1= (the end alone).")
    if saveat is not None and (ts is not None or saveat.dense or not isinstance(saveat.subs, diffrax.SubSaveAt)):
        raise ValueError(
            "saveat= goes with t1=, without dense= and subs=; give SaveAt(ts=...), SaveAt(steps=True), or ts=."
        )
    zero = validation.number("t0", t0)
    inner = None if saveat is None else saveat.subs.ts
    if inner is not None and validation.fails(lambda ts, t0, t1: (ts >= t0) & (ts <= t1), inner, t0, t1):
        raise ValueError(
            f"saveat.ts={validation.shown(inner)} must lie between t0={validation.shown(zero)} and t1={t1}."
        )
    if ts is None:
        validation.number("t1", t1)
        end = since(t0, t1)
        if validation.fails(lambda passed: passed > 0, end):
            raise ValueError(
                f"t1={validation.shown(t1)} does not lie after t0={validation.shown(zero)}; give a later t1=."
            )
        saved = None
    else:
        validation.numbers("ts", ts, "times in s")
        saved = since(t0, ts)
        end = saved[-1]
        if validation.fails(lambda passed: np.diff(passed) > 0, saved):
            first = int(np.argmin(np.diff(saved) > 0))
            raise ValueError(
                f"ts must increase, but ts[{first}]={float(ts[first]):.9g} is followed by {float(ts[first + 1]):.9g}; sort "
                "it and drop doubles."
            )
        if validation.fails(lambda passed: (passed[0] >= 0) & (passed[-1] > 0), saved):
            raise ValueError(
                f"ts={validation.shown(ts)} does not lie after the start t0={validation.shown(zero)}; give later times, or t0=."
            )
    if by_the_clock or validation.fails(lambda t0: t0 != 0, t0):
        whole = None if ts is None else jnp.asarray(ts, dtype)
        return Times(None, zero.astype(dtype), jnp.asarray(t1, dtype) if whole is None else whole[-1], whole)
    saved = None if saved is None else jnp.asarray(saved, dtype)
    return Times(zero, jnp.zeros((), dtype), jnp.asarray(end, dtype) if saved is None else saved[-1], saved)


def knots(system, run: Times, equal: bool, controller, n_steps) -> tuple[Any, Any]:
    """Times in s since the begin at which a step is to end, and whether the run leaves a `Record`; each None if not so.

    **Raises:** `ValueError` where steps would pass over a `Record` or an `Impulse`, and where the run is known to leave it.
    """
    found, unknown = known_knots(system, run.clock, run.start, run.end) if isinstance(system, System) else (None, None)
    adapts = isinstance(controller, diffrax.AbstractAdaptiveStepSizeController)
    if found is not None and not equal and (n_steps is not None or (controller is not None and not adapts)):
        raise ValueError(
            "n_steps=, dt0= or stepsize_controller= would pass over a Record or an Impulse; leave it out, or give a "
            "controller that adapts."
        )
    return found, unknown


def interval(t1, t0) -> tuple[float, float]:
    """Begin and end of a run in s, known."""
    times(None, t1, t0, None, jnp.result_type(float))
    return float(units.in_unit("t0", t0, "s")), float(units.in_unit("t1", t1, "s"))


def checked_tolerance(tolerance, dtype, scene: tuple) -> Float[Array, ""]:
    name = jnp.dtype(dtype).name
    if tolerance is None:
        tolerance = _DEFAULT_TOLERANCE[name]
    tolerance = validation.positive("tolerance", tolerance, "", "relative error of the tip's position")
    if validation.fails(lambda tolerance: tolerance < 1, tolerance):
        raise ValueError(
            f"tolerance={validation.shown(tolerance)} is a relative error of 1 or more; give a smaller one."
        )
    if validation.fails(lambda tolerance: tolerance >= LEAST_TOLERANCE[name], tolerance):
        other = precision.remedy(*scene) if name == "float32" else "take a larger one"
        raise ValueError(
            f"tolerance={validation.shown(tolerance)} is beyond {name}, which reaches {LEAST_TOLERANCE[name]:.0e}; {other}."
        )
    return tolerance.astype(dtype)


def check_steps(solver, stepsize_controller, dt0, n_steps, plain: bool) -> None:
    if not isinstance(solver, diffrax.AbstractSolver | AbstractMultistep):
        raise ValueError(
            f"solver={validation.given(solver)} is not a solver; give an instance, such as diffrax.Tsit5()."
        )
    if dt0 is not None:
        validation.positive("dt0", dt0, "s", "seconds")
    if n_steps is not None:
        n_steps = validation.number("n_steps", n_steps)
        if validation.fails(lambda n: (n >= 1) & (n == np.floor(n)), n_steps):
            raise ValueError(f"n_steps={validation.shown(n_steps)} must be a positive whole number.")
        if dt0 is not None or stepsize_controller is not None:
            raise ValueError(
                f"n_steps={validation.brief(n_steps)} fixes the steps; leave out dt0= and stepsize_controller=."
            )
    elif isinstance(solver, BlanesMoan6 | ABA864) and plain:
        return  # steps are counted by the tolerance
    elif dt0 is None and stepsize_controller is None and not isinstance(solver, diffrax.AbstractAdaptiveSolver):
        raise ValueError(f"solver={type(solver).__name__}() estimates no error to adapt steps by; give n_steps=.")
