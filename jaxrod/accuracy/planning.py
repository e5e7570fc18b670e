"""`plan`: the cheapest way to a number that is good enough, found by trying.

1. *What is true?*  The exact rod in motion, with more and more modes.  Where it does not take the scene or the quantity, or not
   in good time: rungs of more and more shapes, until three of them agree to a part of the tolerance.  What is left of these
   is taken to fall as 1 / shapes where the strain jumps (let go from a stretch, struck), else, as after a sudden spin, as its
   square.  Where the truth is never found, or where rounding alone would grow beyond the tolerance, it cannot be met.
2. *Which rung?*  The cheapest that differs from it by less than nine tenths of the tolerance.  Rigid and condensed rods are
   tried only where closed forms give them a chance: with delta = (turning rate / axial rate)^2, after an angle omega T, a
   rigid rod is off by 2 delta omega T, and one whose strain follows its loads by 3/2 delta^2 omega T + 2 delta^(3/2).
3. *Which steps?*  For each solver and float type the fewest with which the rung comes out to nine tenths of what is left of it,
   sought by the order of the method.  What a stage costs is measured once, by `benchmarks/calibration.py`.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import continuum
from ..core import progress, tracing, validation
from ..core.precision import in_type
from ..mechanics.system import System
from ..motions.state import State
from ..rods.lumped import Lumped
from ..runs import arguments
from ..runs.defaults import by_equal_steps
from ..runs.scales import Scales
from ..shapes.basis import AbstractBasis, ForceRitz, QuasiStatic, Ritz
from ..shapes.load_basis import LoadRitz
from .error_budget import NUDGE, nudged, parted
from .fewest_steps import Question, Rung, Way, ways_of
from .ladder import brought, condensable, padded, projected, richer
from .quantity import AbstractQuantity, FinalAngle, FinalTip, as_quantity
from .reference import apart, comparable, exact_answer
from .run_plan import Plan, named, step_rate

_SHAPES = (2, 3, 4, 6, 9, 12, 16, 24)  # of the rungs above uniform strain; from four on they may stand for the truth
_AGREED = 0.1  # of the tolerance: answers that differ by less have come to the true one
# Powers of 1 / shapes, with a jump and without, by which errors of 4 shapes fell at the most to 24.
_STEEPEST = (3.5, 4.6)
_FOR_MODEL, _FOR_ROUNDING = 0.9, 0.1  # shares of the tolerance
_AT_MOST = 0.99  # of it: the most that the model may take where no rung takes less
_ROOMY = 0.4  # of the tolerance: a rung that takes more may be dearer by its steps than the next
_FOR_STEPS = 0.9  # of what is left of it
_HOPELESS = 10.0  # tolerances, by closed form, beyond which a rung is not tried
_FINE, _FINEST = 1e-11, 1e-12  # tolerance of the runs that a rung is judged by, and of one that judges these


class _Truth(NamedTuple):
    """The answer, how far it may be from the true one, what gave it and why it is believed, and a rung that is near."""

    value: np.ndarray
    apart: float
    name: str
    why: str
    rung: Rung


def plan(
    system: System,
    start: State,
    *,
    t1: float,
    tolerance: float,
    quantity: AbstractQuantity | Callable | None = None,
    t0: float = 0.0,
    static: bool = False,
) -> Plan:
    """The cheapest rung, solver, steps and float type with which a quantity of this scene is good to `tolerance`.

    **Arguments:**

    - `system`, `start`: the scene; of its basis only the start's strain is read, as other rungs take the nearest one.
    - `t0`, `t1`: when it begins and ends, in s.
    - `tolerance`: the largest error of the quantity, in its unit.
    - `quantity`: what is asked, such as `jaxrod.FinalTip()` (the default), or a function of a solution.
    - `static`: start the rod stretched as it is at rest in its spin and gravity, on each rung by that rung's own strain.

    **Returns:** a `Plan`; `simulate(system, start, plan=plan)` follows it, under `sweep` too.  If none is found, its
    `met` is false and `why` says what stands in the way.

    **Raises:** `ValueError` if the tolerance is not positive, t1 not after t0, `quantity` none that can be asked for, numbers of
    the scene are traced, no `static` strain holds the rod, or there is no float64 (call `jaxrod.configure()` first).

    It takes ten to fifty runs of the scene, and compiles the rungs that it tries: seconds, or a minute for the first scene
    of a kind.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.01), young=2e11, density=7800.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> found = jaxrod.plan(system, system.state(), t1=1.0, tolerance=1e-3)
    >>> print(found.met, found.basis.n)
    True 0
    """
    arguments.check_known(system, start, "plan one like it before, and follow it by simulate(plan=plan)", static)
    quantity = as_quantity(quantity)
    tolerance = float(validation.positive("tolerance", tolerance, quantity.unit, "the quantity's unit"))
    system, start = in_type("float64", (system, start))
    begin, end = arguments.interval(t1, t0)
    with progress.line("plan"):
        return _Search(system, start, quantity, begin, quantity.times(begin, end), static, tolerance).plan()


class _Search:
    """The scene, what is asked of it, and the rungs that were tried."""

    def __init__(
        self, system: System, start: State, quantity: AbstractQuantity, t0, ts, static: bool, tolerance: float
    ):
        self.system, self.start, self.static, self.tolerance = system, start, static, tolerance
        self.question = Question(quantity, t0, ts)
        self.tried: dict[str, Rung] = {}
        self.family = richer(system)
        jumps = self.family is ForceRitz or (not static and bool(jnp.any(start.amplitudes != 0)))
        self.power, self.steepest = (1 if jumps else 2), _STEEPEST[not jumps]  # of 1 / shapes, by which errors fall

    def plan(self) -> Plan:
        truth = self.truth()
        growth, rounding = self.rounding(truth.rung)
        unit, nearest = (
            f" {self.question.quantity.unit}".rstrip(),
            Way(truth.rung, None, "float64", 0, 0.0, 0.0, math.inf),
        )
        if math.isinf(growth) and math.isfinite(truth.apart):
            return self.planned(nearest, math.inf, False, "the motion is beyond its horizon (see jaxrod.horizon)")
        if not truth.apart <= _FOR_MODEL * self.tolerance:
            why = f"the answer of {truth.name} is known to {truth.apart:.1e}{unit} at best"
            if not math.isfinite(truth.apart):
                why = f"{truth.name} does not reach the end, or a rung below it"
            if np.isnan(truth.rung.value).any() and bool(truth.rung.fine.ok):
                why = f"the {self.question.quantity.name} is no number"
            return self.planned(nearest, truth.apart, False, why)
        if not math.isfinite(rounding):
            return self.planned(nearest, math.inf, False, f"{named(truth.rung.basis)} does not reach the end")
        if not rounding <= _FOR_ROUNDING * self.tolerance:
            return self.planned(nearest, rounding, False, f"rounding alone grows to {rounding:.1e}{unit}")
        ways, tried = [], []
        for rung in self.rungs(truth):
            known = apart(rung.value, truth.value) + truth.apart
            tried.append((known, rung))
            if known <= _FOR_MODEL * self.tolerance:
                ways += [(way, known) for way in self.ways(rung, known, rounding, growth)]
                roomy = known <= _ROOMY * self.tolerance  # else more shapes may leave more to the steps
                if ways and roomy and not (isinstance(rung.basis, QuasiStatic) or rung.basis.n == 1):
                    break  # none is cheaper than a rigid rod, and more shapes cost more
            elif self.hopeless(tried):
                break
        known, rung = min(tried, key=lambda found: found[0])
        if not ways and _FOR_MODEL * self.tolerance < known <= _AT_MOST * self.tolerance:  # dear, but better than none
            ways = [(way, known) for way in self.ways(rung, known, rounding, growth)]
        if not ways:
            why = "no number of steps was found that reaches it"
            if known > _AT_MOST * self.tolerance:
                why = f"{named(rung.basis)} is {known:.1e}{unit} from {truth.name}, and {_SHAPES[-1]} shapes would not mend it"
            return self.planned(nearest._replace(rung=rung), known, False, why)
        way, known = min(ways, key=lambda found: found[0].cost)
        why = f"{known:.1e}{unit} from {truth.name}{truth.why}"
        return self.planned(way, known + way.off + rounding, True, why)

    def truth(self) -> _Truth:
        """The exact rod's answer, or that of the first rung with the answer of those below it."""
        if isinstance(self.system.rod, Lumped):
            rung = self.rung(self.system.basis)
            return _Truth(rung.value, 0.0, named(rung.basis), ", the only rung of a Lumped body", rung)
        exact, wanted = None, _AGREED * self.tolerance
        if comparable(self.question.quantity):
            exact = exact_answer(
                self.system, self.start, self.question.quantity, self.question.t0, self.question.ts, self.static, wanted
            )
        # Rungs know better only where there was no time for more modes.
        known = exact is not None and exact.apart <= _FOR_MODEL * self.tolerance
        if exact is not None and (known or exact.complete or math.isinf(exact.apart)):
            return _Truth(exact.value, exact.apart, "the exact rod", "", self.rung(self.family(_SHAPES[2])))
        below: list[Rung] = []
        left = [math.inf]
        for n in _SHAPES[2:]:
            rung = self.rung(self.family(n))
            # What more shapes would still change, by two pairs: either may agree by chance.
            left = [apart(rung.value, x.value) / ((n / x.basis.n) ** self.power - 1) for x in below[-2:]]
            below.append(rung)
            if len(left) > 1 and (max(left) <= wanted or all(np.isnan(x.value).any() for x in below[-2:])):
                break
        return _Truth(
            below[-1].value, max(left), named(below[-1].basis), ", with which those below it agree", below[-1]
        )

    def rounding(self, rung: Rung) -> tuple[float, float]:
        """By how many times what each number is rounded by the answer moves, and by how much in float64, or by finer steps if
        that is more; inf beyond the horizon."""
        nudge = NUDGE["float64"]
        finest = self.question.run(rung.projected, rung.start, tolerance=_FINEST)
        aside = self.question.run(rung.projected, nudged(rung.start, nudge), tolerance=_FINE)
        if bool(parted(rung.fine, finest) | parted(rung.fine, aside)):
            return math.inf, math.inf
        moved = apart(self.question.answer(aside), rung.value) / nudge + float(np.max(np.abs(rung.value)))
        growth = math.sqrt(1 + rung.fine_steps) * moved
        return growth, max(growth * float(np.finfo(np.float64).eps), apart(self.question.answer(finest), rung.value))

    def rungs(self, truth: _Truth) -> Iterator[Rung]:
        """Those with a chance, the cheapest first."""
        if isinstance(self.system.rod, Lumped):
            yield truth.rung
            return
        rigid, following = self.closed_forms()
        # Driven, a rigid rod has nothing to move.
        if rigid <= _HOPELESS * self.tolerance and not self.system.motion.prescribed:
            yield self.rung(Ritz(0))
        if following <= _HOPELESS * self.tolerance and condensable(self.system):
            yield self.rung(QuasiStatic(LoadRitz(2)))
        yield from (self.rung(basis) for basis in (Ritz(1), ForceRitz(1)) if not basis.misfit(self.system.rod))
        yield from (self.rung(self.family(n)) for n in _SHAPES)

    def closed_forms(self) -> tuple[float, float]:
        """Errors to be expected of a rigid rod and of a strain that follows its loads; zero where no closed form says."""
        if self.static or not isinstance(self.question.quantity, FinalAngle | FinalTip):
            return 0.0, 0.0
        system, start = self.system, self.start
        t0, t1 = (jnp.asarray(t, float) for t in (self.question.t0, self.question.ts[-1]))
        turning = float(_turning(system, start, t0, t1))
        delta = (
            turning / (2 * math.pi * float(continuum.natural_frequencies(dataclasses.replace(system, forces=()), 1)[0]))
        ) ** 2
        angle = turning * float(t1 - t0)
        arm = float(system.rod.length) if isinstance(self.question.quantity, FinalTip) else 1.0
        return arm * 2 * delta * angle, arm * (1.5 * delta**2 * angle + 2 * delta**1.5)

    def hopeless(self, tried: list[tuple[float, Rung]]) -> bool:
        """Whether the most shapes would be too few, as far as the rungs tell that may: errors do not fall evenly."""
        least = [
            known * (rung.basis.n / _SHAPES[-1]) ** self.steepest for known, rung in tried if rung.basis.n >= _SHAPES[2]
        ]
        return not self.static and bool(least) and min(least) > self.tolerance

    def rung(self, basis: AbstractBasis) -> Rung:
        if named(basis) not in self.tried:
            progress.say(f"{named(basis)} by fine steps")
            system, start = brought(self.system, self.start, padded(basis), self.static, self.question.t0)
            ready = projected(system)
            fine = self.question.run(ready, start, tolerance=_FINE)
            self.tried[named(basis)] = Rung(basis, system, ready, start, self.question.answer(fine), fine)
        return self.tried[named(basis)]

    def ways(self, rung: Rung, known: float, rounding: float, growth: float) -> Iterator[Way]:
        """Solvers and float types with their fewest steps, on a rung that is off by `known`."""
        # How float32 rounds shows in the runs themselves, which are held against float64: what is foreseen only tells whether
        # they are worth a try.
        narrow = growth * float(np.finfo(np.float32).eps) <= self.tolerance
        enough = _FOR_STEPS * (self.tolerance - known - rounding)
        return ways_of(self.question, rung, enough, ("float64", "float32") if narrow else ("float64",))

    def planned(self, way: Way, error: float, met: bool, why: str) -> Plan:
        rung, duration = way.rung, float(self.question.ts[-1] - self.question.t0)
        equal = by_equal_steps(way.solver)
        return Plan(
            met=met,
            basis=rung.basis,
            solver=way.solver,
            dtype=way.dtype,
            step=duration / way.setting if equal else None,
            tolerance=None if equal else way.setting,
            rate=float(step_rate(rung.system, rung.start, self.question.t0, self.question.ts[-1])),
            n_steps=way.steps,
            static=self.static,
            error=error,
            cost=way.cost,
            asked=self.tolerance,
            quantity=self.question.quantity.name,
            unit=self.question.quantity.unit,
            why=why,
        )


@tracing.run_seldom
def _turning(system: System, start: State, t0, t1) -> Float[Array, ""]:
    """How fast the rod turns, in rad/s."""
    return Scales.of(system.discrete, start, t0, t1).mean
