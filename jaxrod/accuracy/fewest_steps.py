"""The fewest steps with which a rung comes out to an error: sought by the order of the method, one run a try."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from ..core import progress
from ..core.precision import in_type
from ..mechanics.system import System
from ..motions.state import State
from ..runs.defaults import by_equal_steps, solvers
from ..runs.execution import SELDOM, solve
from ..runs.fixed_steps import LEAST_TOLERANCE
from ..runs.solution import Solution
from ..shapes.basis import AbstractBasis
from . import cost_model
from .ladder import unprojected
from .quantity import AbstractQuantity
from .reference import apart, comparable
from .run_plan import named

_MOST_STEPS = 2**24
_TRIES = 8  # step counts of one solver and type
_NEAR = 1.5  # a step count within this factor of one too few is good enough
_BESIDE = 1.07
_LOOSE, _LOOSEST = 1e-4, 0.1  # tolerances that the search begins with and goes to, of solvers that adapt their steps


@dataclasses.dataclass(frozen=True)
class Question:
    """A `quantity` of runs from t0 (s) that save at `ts` (s)."""

    quantity: AbstractQuantity
    t0: float
    ts: Float[Array, " T"]

    def run(self, system: System, start: State, seldom: bool = True, **how: Any) -> Solution:
        ts = self.ts.astype(start.direction.dtype)
        return solve(system, start, t0=self.t0, ts=ts, max_steps=_MOST_STEPS, seldom=seldom, **how)

    def answer(self, solution: Solution) -> np.ndarray:
        """The quantity, NaN if the run does not reach its end."""
        if not comparable(self.quantity):  # a function of one's own may ask it of another rod
            solution = dataclasses.replace(solution, system=unprojected(solution.system))
        return np.where(bool(solution.ok), np.asarray(self.quantity(solution), float), np.nan)


class Rung(NamedTuple):
    """A scene with a basis, the same with its projection made, its start, the quantity by fine steps, and the run of these."""

    basis: AbstractBasis
    system: System
    projected: System
    start: State
    value: np.ndarray
    fine: Solution

    @property
    def fine_steps(self) -> float:
        return float(self.fine.stats["num_steps"])


class Way(NamedTuple):
    """Solver, type and steps on a rung; `setting` is their number or, of a solver that adapts them, the tolerance."""

    rung: Rung
    solver: Any
    dtype: str
    steps: int
    setting: float
    off: float
    cost: float


def ways_of(question: Question, rung: Rung, enough: float, dtypes: tuple[str, ...]) -> Iterator[Way]:
    """By each solver and float type the fewest steps with which a rung comes out to `enough`."""
    for dtype in dtypes:
        for solver in solvers(in_type(dtype, rung.system)):
            tried = functools.cache(functools.partial(_tried, question, rung, solver, dtype))
            if by_equal_steps(solver):
                least, begin, order = float(question.ts.size), rung.fine_steps / 8, solver.accuracy
            else:
                order = solver.order(None)
                least, begin = _LOOSEST ** (-1 / order), _LOOSE ** (-1 / order)
            steps = fewest(lambda steps, tried=tried: tried(steps).off, least, begin, order, enough)
            if steps is not None:
                yield tried(steps)


def fewest(off: Callable[[float], float], least: float, begin: float, order: int, enough: float) -> float | None:
    """The fewest steps, not below `least`, with which off(steps) <= enough, to a factor of 1.5; None if none are found.

    The search begins with `begin` and takes off(steps) to fall as their power `order`.

    >>> from jaxrod.accuracy.fewest_steps import fewest
    >>> found = fewest(lambda steps: steps**-4.0, least=1.0, begin=3.0, order=4, enough=1e-8)
    >>> print(100 <= found <= 150)
    True
    """
    steps, found, failed = begin, None, 0.0
    for _ in range(_TRIES):
        steps = max(steps, least)
        error = off(steps)
        # A zero of the error, between two signs of it, would pass for a small one.
        good = error <= enough and off(_BESIDE * steps) <= enough
        if good:
            found = steps
        else:
            failed = steps
        near = found is not None and found <= max(_NEAR * failed, least)
        if near or failed > _MOST_STEPS:
            break
        if found is not None and failed:
            steps = math.sqrt(failed * found)
            continue
        factor = 1.1 * (error / enough) ** (1 / order) if math.isfinite(error) else 4.0
        steps *= min(max(factor, 1 / 8), 1 / 1.2) if good else min(max(factor, 1.3), 8.0)
    return found


def _tried(question: Question, rung: Rung, solver: Any, dtype: str, steps: float) -> Way:
    """One run.  Of a solver that adapts its steps `steps` stands for the tolerance, with whose power their number grows."""
    progress.say(f"{named(rung.basis)} by {steps:.3g} steps of {type(solver).__name__}, {dtype}")
    # In float32 the numbers of the rod are rounded before it is projected, as in a run of one's own.
    system = rung.projected if dtype == "float64" else in_type(dtype, rung.system)
    start, seldom = in_type(dtype, rung.start), rung.fine_steps < SELDOM
    if by_equal_steps(solver):
        setting = float(round(steps))
        solution = question.run(system, start, solver=solver, n_steps=round(steps), seldom=seldom)
    else:
        setting = max(steps ** -solver.order(None), LEAST_TOLERANCE[dtype])
        solution = question.run(system, start, tolerance=setting, seldom=seldom)
    taken, off = float(solution.stats["num_steps"]), apart(question.answer(solution), rung.value)
    cost = cost_model.seconds(dataclasses.replace(system, basis=rung.basis), solver, taken)
    return Way(rung, solver, dtype, int(taken), setting, off, cost)
