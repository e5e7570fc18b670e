"""How wrong is this number?  The error of a run in three parts, each measured by another run.

- *Model*: the same motion with more strain shapes, and with still more; what is left beyond them by errors that fall as
  1 / shapes, as slowly as those of a strain that jumps.
- *Step*: the same scene at the least tolerance that its float type reaches.
- *Rounding*: by how much a start that is off by a relative 1e-10 moves the answer, times the rounding of the numbers,
  times the square root of the number of steps.

An error that reaches a quarter of the range of the quantity is no error bound but a lost phase, and is said to have none.
Nor is there one beyond the horizon of the motion: where finer steps, or that other start, lead somewhere else, runs agree
by chance alone.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..continuum.neglected import ModelLimits, model_limits
from ..core import calling, progress, tracing
from ..core.result import Result
from ..mechanics.system import System
from ..motions.state import State
from ..rods.rod import Rod
from ..runs.execution import SELDOM
from ..runs.fixed_steps import LEAST_TOLERANCE
from ..runs.solution import Solution
from .ladder import brought, first_shapes, richer
from .quantity import AbstractQuantity

_FLOOR = 1e-12  # no bound is below it
_LOST = 0.25  # of the range: beyond it the phase is lost
_SHAPES = ((6, 3), (9, 6))  # of the runs with more shapes: at least, and more than the run itself
_TOLERANCE = {"float64": 1e-10, "float32": 1e-5}  # of the runs with more shapes
NUDGE = {"float64": 1e-10, "float32": 1e-5}
_APART = 0.25  # of two directors: beyond it runs have nothing to do with each other


class Budget(eqx.Module):
    """A quantity of a run and its error; it prints itself.  All in the quantity's unit, of its shape.

    `value`; `model`, `step` and `rounding`, the parts of the error; `span`, the range of the quantity; `lost`, whether the
    run goes beyond the horizon of its motion; `limits`, what the model of a straight rod leaves out, in numbers (None for a
    `Lumped` body, of which `model` is zero: it is its own model); `strain`, the largest of any section, by Hooke's law.
    """

    value: Float[Array, "*numbers"]
    model: Float[Array, "*numbers"]
    step: Float[Array, "*numbers"]
    rounding: Float[Array, "*numbers"]
    span: Float[Array, ""]
    lost: Bool[Array, ""]
    limits: ModelLimits | None
    strain: Float[Array, ""] | None
    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    @property
    def bounded(self) -> Bool[Array, "*numbers"]:
        """Whether there is a bound: not where the phase is lost."""
        return ~self.lost & (self.model + self.step + self.rounding < _LOST * self.span)

    @property
    def bound(self) -> Float[Array, "*numbers"]:
        """Sum of the parts, at least 1e-12; inf where there is no bound."""
        return jnp.where(self.bounded, jnp.maximum(self.model + self.step + self.rounding, _FLOOR), jnp.inf)

    def __str__(self):
        if not tracing.known(self.value) or self.span.ndim:
            return f"Budget of the {self.name} of many runs: `bound` and its parts have their leading axes"
        lines, unit = [], f" {self.unit}".rstrip()
        for index in np.ndindex(self.value.shape):
            at = f"[{', '.join(map(str, index))}]" if index else ""
            parts = ", ".join(
                f"{name} {float(getattr(self, name)[index]):.1e}" for name in ("model", "step", "rounding")
            )
            bound = f"± {float(self.bound[index]):.1e}" if self.bounded[index] else f"no bound: {self._why_not(index)}"
            lines.append(f"{self.name}{at} = {float(self.value[index]):.10g}{unit} {bound} ({parts})")
        lines += [] if self.limits is None else [f"left out: {line}" for line in str(self.limits).splitlines()]
        if self.strain is not None:
            lines.append(
                f"left out: how stiffness changes with strain, here up to {float(self.strain):.2g} (Rod(law=...) has it)"
            )
        return "\n".join(lines)

    def _why_not(self, index) -> str:
        if self.lost:
            return "the motion is beyond its horizon"
        if not np.isfinite(float(self.value[index])):
            return "it is no number"
        failed = not np.isfinite(float(self.model[index] + self.step[index] + self.rounding[index]))
        return "this run or a finer one did not reach its end" if failed else "the phase is lost"


class FinerRuns(NamedTuple):
    """What a `solution` is held against: the same scene by finer steps, from a start beside, and with more shapes, twice; a
    `Lumped` body has no more."""

    solution: Solution
    finer: Solution
    aside: Solution
    richer: tuple[Solution, Solution] | None


def budgets(
    quantities: list[AbstractQuantity], system: System, start: State, solution: Solution,
    run: Callable[..., Solution], own_times: Callable[[AbstractQuantity], Array | None],
) -> tuple[Budget, ...]:  # fmt: skip
    """The error of each quantity of `solution`; they share the runs that tell it, at all times that any of them looks at.

    `run(system, start)` runs as `solution` was run, `run(system, start, tolerance)` by the default solver to a tolerance;
    `times=` are in place of those that `solution` saved, `seldom=` is for programs of few runs.
    `own_times` of a quantity: None where it looks at the saved ones.
    """
    for quantity in quantities:  # one that fails does so before the runs
        calling.rehearsed(quantity, solution)
    own = [own_times(quantity) for quantity in quantities]
    looked = [times for times in own if times is not None]
    if looked:
        times = looked[0] if len(looked) == 1 else jnp.unique(jnp.concatenate(looked))
        run = functools.partial(run, times=times, seldom=_short(solution))

    @functools.cache
    def shared():
        return finer_runs(system, start, run(system, start) if looked else solution, run)

    return tuple(
        budget_of(quantity, system, solution if times is None else None, shared)
        for quantity, times in zip(quantities, own, strict=True)
    )


def finer_runs(system: System, start: State, solution: Solution, run: Callable[..., Solution]) -> FinerRuns:
    """By `run`, as `budgets` has it."""
    name = jnp.dtype(start.direction.dtype).name
    progress.say("by finer steps")
    finer = run(system, start, LEAST_TOLERANCE[name])
    progress.say("from a start beside")
    aside = run(system, nudged(start, NUDGE[name]))
    if not isinstance(system.rod, Rod):
        return FinerRuns(solution, finer, aside, None)
    few, many = _more_shapes(system)
    progress.say(f"with {few} and {many} shapes")
    rungs = [first_shapes(richer(system)(n), many) for n in (few, many)]  # one program for both
    seldom = _short(solution)
    less, more = (run(*brought(system, start, basis, False, 0.0), _TOLERANCE[name], seldom=seldom) for basis in rungs)
    return FinerRuns(solution, finer, aside, (less, more))


def _short(solution: Solution) -> bool:
    """Whether runs like this one are over sooner than their program is optimised."""
    steps = solution.stats["num_steps"]
    return tracing.known(steps) and float(steps) < SELDOM


def _more_shapes(system: System) -> tuple[int, ...]:
    """Of the runs with more of them, the poorer first."""
    return tuple(max(least, system.basis.n + further) for least, further in _SHAPES)


def budget_of(
    quantity: AbstractQuantity, system: System, solution: Solution | None, runs: Callable[[], FinerRuns]
) -> Budget:
    """The error of `quantity` of `solution`, or (None) of the one that the `runs` are of; they are asked for where needed."""
    if solution is None:
        solution = runs().solution
    exact, limits = quantity.exact(system), _limits(system) if isinstance(system.rod, Rod) else None
    if exact is not None:
        value = quantity(solution)
        zero, rounding = jnp.zeros_like(value), 100 * jnp.finfo(value.dtype).eps * jnp.abs(value)
        parts, lost = (jnp.abs(value - exact), zero, rounding), jnp.asarray(False)
    else:
        value = quantity(solution)
        parts, lost = _parts(quantity, system, value, runs())
    span, strain = jnp.asarray(quantity.span(system), value.dtype), _strain(system, solution)
    return Budget(value, *parts, span, lost, limits, strain, quantity.name, quantity.unit)


def _parts(quantity, system: System, value, runs: FinerRuns) -> tuple[tuple[Array, Array, Array], Bool[Array, ""]]:
    """Errors of the model, of the steps and of rounding; and whether the run goes beyond its horizon."""
    solution = runs.solution  # saved when the others are
    each = [solution, runs.finer, runs.aside, *(runs.richer or ())]
    lost = parted(solution, runs.finer) | parted(solution, runs.aside)
    # What a quantity of one's own takes is not known, so each of its answers is a program of its own.
    answers, ends = [quantity(run) for run in each], [(run.result, run.ts) for run in each]
    sizes = np.array([system.basis.n, *_more_shapes(system)], value.dtype)
    return _compared(value, answers, ends, solution.stats["num_steps"], sizes), lost


@tracing.run_seldom
def _compared(value, answers, ends, steps, sizes) -> tuple[Array, Array, Array]:
    """Errors of the model, of the steps and of rounding, by answers of the run, a finer one, one from beside and, where there are
    some, of two with more shapes; how and where these `ends`, and their `sizes`.  One program for all scenes."""
    own, fine, aside, *richer = answers
    (own_result, ts), *others = ends
    fine, aside, *richer = (
        jnp.where(_ended(result, there, ts), x, jnp.nan)
        for x, (result, there) in zip((fine, aside, *richer), others, strict=True)
    )
    value = jnp.where(_ended(own_result, ts, others[0][1]), value, jnp.nan)
    moved = jnp.abs(aside - own) / NUDGE[ts.dtype.name]
    rounding = jnp.finfo(value.dtype).eps * jnp.sqrt(1.0 + steps) * (moved + jnp.abs(value))
    model = jnp.zeros_like(value)
    if richer:
        less, more = richer
        least, few, many = sizes
        # By both pairs, as either may agree by chance.
        of_two, of_all = _beyond(few, less, many, more), _beyond(least, fine, many, more)
        model = jnp.abs(fine - more) + jnp.maximum(of_two, of_all)
    model, step, rounding = (jnp.where(jnp.isfinite(x), x, jnp.inf) for x in (model, jnp.abs(value - fine), rounding))
    return model, step, rounding


_limits = tracing.run_seldom(model_limits)  # one program: its eager steps take longer than a short run


@tracing.run_seldom
def _strain(system: System, solution: Solution) -> Float[Array, ""] | None:
    hooke = isinstance(system.rod, Rod) and system.rod.linear
    if not (hooke and system.basis.n and isinstance(solution.states, State)):
        return None
    return jnp.nanmax(jnp.abs(system.body.field(solution.states.amplitudes)))


def parted(one: Solution, other: Solution) -> Bool[Array, ""]:
    """Whether two runs point elsewhere at a time that both saved."""
    if not (isinstance(one.states, State) and isinstance(other.states, State) and one.ts.shape == other.ts.shape):
        return jnp.asarray(False)
    return _parted(one.ts, one.states.direction, other.ts, other.states.direction)


@tracing.run_seldom
def _parted(ts, direction, other_ts, other_direction) -> Bool[Array, ""]:
    square = jnp.sum((direction - other_direction) ** 2, axis=-1)
    return jnp.any((square > _APART**2) & (ts == other_ts))


def _ended(result, ts, other_ts) -> Bool[Array, ""]:
    """Whether a run came to its end: where its steps were too long it may have, when the other did."""
    return (result == Result.ok) | ((result == Result.coarse) & (ts[-1] == other_ts[-1]))


def _beyond(few: Array, less: Array, many: Array, more: Array) -> Array:
    """What shapes beyond `many` would still change, if the errors of `less` and `more` fall as 1 / shapes."""
    return jnp.abs(more - less) * few / (many - few)


@tracing.run_seldom
def nudged(start: State, by: float) -> State:
    """A start turned by about `by` rad, stretched by that strain, and faster by that part."""
    d = start.direction + by * _aside(start.direction)
    d = d / jnp.sqrt(d @ d)
    rate = (1 + by) * start.direction_rate
    amplitudes, amplitude_rates = start.amplitudes + by, (1 + by) * start.amplitude_rates
    return dataclasses.replace(
        start,
        direction=d,
        direction_rate=rate - d * (d @ rate),
        amplitudes=amplitudes,
        amplitude_rates=amplitude_rates,
    )


def _aside(d: Float[Array, " D"]) -> Float[Array, " D"]:
    """Across a direction; in space between the way across that is nearest to an axis and the one across both."""
    if d.size == 2:
        return jnp.stack([-d[1], d[0]])
    across = jnp.cross(d, jnp.eye(3, dtype=d.dtype)[jnp.argmin(jnp.abs(d))])
    across = across / jnp.sqrt(across @ across)
    return across + jnp.cross(d, across)
