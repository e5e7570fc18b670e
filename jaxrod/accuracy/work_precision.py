"""Speed for accuracy, measured on the scene at hand: rungs, solvers, steps and float types, each with its error and cost."""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..core import validation
from ..core.precision import in_type
from ..core.progress import line, say
from ..mechanics.system import System
from ..motions.state import State
from ..rods.lumped import Lumped
from ..runs import arguments
from ..runs.defaults import by_equal_steps, solvers
from ..runs.execution import solve
from ..shapes.basis import AbstractBasis, ForceRitz, QuasiStatic, Ritz
from ..shapes.load_basis import LoadRitz
from .ladder import brought, condensable, padded, richer, rung
from .quantity import AbstractQuantity, as_quantity
from .reference import exact_answer
from .run_plan import named

RUNGS: tuple[AbstractBasis, ...] = (
    Ritz(0), QuasiStatic(LoadRitz(2)), Ritz(1), ForceRitz(1), LoadRitz(2), Ritz(3), LoadRitz(4), LoadRitz(6),
)  # fmt: skip
_FRACTIONS = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # of the steps of the default
_TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)  # of a step, of the adaptive solver
_BEST = (6, 9)  # shapes, in place of the exact rod where that would take too long, and to tell how well they know
_KNOWN = 1e-12  # tolerance of the exact rod: it knows no better
_FINE = 1e-11  # tolerance of a rung's own answer
_MODES = 64  # of the exact rod
_REPEATS = 3
_BETTER = 0.9  # of an error: what gains less is not worth a higher cost


class Row(NamedTuple):
    """One way to run the scene: its `error` in the quantity's unit (the largest of its numbers), at least the rung's own, which
    steps may undo by luck; and `cost`, computing time in s for each simulated second, compilation apart."""

    rung: str
    solver: str
    dtype: str
    steps: int
    error: float
    cost: float


class Tradeoff(NamedTuple):
    """What was measured; it prints the rows that no other beats in both error and cost.

    `rows`, all of them, the cheapest first; `quantity`, its name and unit; `reference`, what the errors are measured from, and
    `own_error`, how far that is from a poorer one of its kind: errors near it mean nothing; `left`, ways there was no time for,
    and `seconds`, about how many would have been enough for all.
    """

    rows: list[Row]
    quantity: str
    unit: str
    reference: str
    own_error: float
    left: int
    seconds: float

    @property
    def front(self) -> list[Row]:
        """The rows that no other beats: the cheapest first, each better than all before it by a tenth or more."""
        best, found = np.inf, []
        for row in self.rows:
            error = max(row.error, self.own_error)  # below that it means nothing
            if error < _BETTER * best:
                found.append(row)
                best = error
        return found

    def __str__(self):
        error = f"error, {self.unit}".rstrip(", ")
        lines = [f"{'rung':>24} {'solver':>14} {'type':>8} {'steps':>7} {error:>12} {'ms / s':>9}"]
        for row in self.front:
            lines.append(
                f"{row.rung:>24} {row.solver:>14} {row.dtype:>8} {row.steps:>7} {row.error:>12.1e} {1e3 * row.cost:>9.3g}"
            )
        lines.append(
            f"{self.quantity} against {self.reference}, itself good to {self.own_error:.0e}; {len(self.rows)} runs"
        )
        if self.left:
            lines.append(f"no time for {self.left} more ways: all take about seconds={self.seconds:.2g}")
        return "\n".join(lines)


class _Way(NamedTuple):
    basis: AbstractBasis
    solver: Any
    dtype: str


def tradeoff(
    system: System,
    start: State,
    *,
    t1: float,
    quantity: AbstractQuantity | Callable | None = None,
    t0: float = 0.0,
    static: bool = False,
    seconds: float = 60.0,
    progress: bool | None = None,
) -> Tradeoff:
    """Runs the scene in many ways and measures what each digit costs, here and now.

    **Arguments:**

    - `system`, `start`: the scene, whose rung is tried first, then uniform strain, then others; each takes the nearest strain
      of the start.
    - `t0`, `t1`: when it begins and ends, in s.
    - `quantity`: what is asked, such as `jaxrod.FinalTip()` (the default), or a function of a solution.
    - `static`: start the rod stretched as it is at rest in its spin and gravity, on each rung by that rung's own strain.
    - `seconds`: stop after so much time, however many ways are left; the reference and the way that is under way are finished,
      and each takes some seconds to compile.
    - `progress`: a line of what is done; if left out, on a terminal or in a notebook.

    **Returns:** a `Tradeoff`; `jaxrod.plot.tradeoff` draws it.

    **Raises:** `ValueError` if `seconds` is not positive, t1 not after t0, `quantity` none that can be asked for or no number,
    numbers of the scene are traced, no `static` strain holds the rod, there is no float64, or the rod is a `Lumped` body, which
    has one rung.

    Errors are measured from the exact rod in motion (`continuum.simulate`) where it takes that scene in good time, else from
    nine shapes; `reference` says which.  With a force at the tip `ForceRitz` is tried beside `LoadRitz`.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> found = jaxrod.tradeoff(system, system.state(rate=15.0), t1=0.1, seconds=1.0, progress=False)
    >>> print(found.reference, len(found.front) > 0)
    the exact rod True
    """
    seconds = float(validation.positive("seconds", seconds, "s", "seconds of computing"))
    arguments.check_known(system, start, "measure one like it by itself", static)
    if isinstance(system.rod, Lumped):
        raise ValueError("a Lumped body has one rung only; give a Rod to trade speed for accuracy.")
    validation.optional_switch("progress", progress)
    quantity = as_quantity(quantity)
    t0, t1 = arguments.interval(t1, t0)
    with line("tradeoff", progress):
        return _tradeoff(system, start, quantity, t0, quantity.times(t0, t1), static, seconds)


def _tradeoff(
    system: System, start: State, quantity: AbstractQuantity, t0, ts, static: bool, seconds: float
) -> Tradeoff:
    begun = time.perf_counter()
    true, own_error, reference = _reference(system, start, quantity, t0, ts, static)
    if np.isnan(true).any():
        raise ValueError(f"the {quantity.name} of {reference} is no number (NaN); ask for one that is.")
    ways, rows, done, own = list(_ways(system)), [], 0, {}
    known = passed = time.perf_counter() - begun
    for way in ways:
        if rows and passed > seconds:
            break
        name = named(way.basis)
        say(f"way {done + 1} of {len(ways)}, {name} by {type(way.solver).__name__}; {passed:.0f} of {seconds:.3g} s")
        if name not in own:
            scene, begin = brought(system, start, padded(way.basis), static, t0)
            fine = solve(scene, begin, t0=t0, ts=ts, tolerance=_FINE, seldom=True)
            own[name] = float(jnp.nan_to_num(jnp.max(jnp.abs(quantity(fine) - true))))
        found = _measured(way, system, start, quantity, t0, ts, static, true)
        rows += [row._replace(error=max(row.error, own[name])) for row in found]
        done += 1
        passed = time.perf_counter() - begun
    rows = sorted((row for row in rows if np.isfinite(row.error)), key=lambda row: row.cost)
    enough = known + (passed - known) * len(ways) / max(done, 1)
    return Tradeoff(rows, quantity.name, quantity.unit, reference, own_error, len(ways) - done, enough)


def _ways(system: System) -> Iterator[_Way]:
    """The scene's own rung and the likeliest first: the default on each rung, float32, the other solvers, steps that adapt."""
    rungs = [x for x in RUNGS if condensable(system) or not isinstance(x, QuasiStatic)]
    rungs = [x for x in rungs if not x.misfit(system.rod)]
    family = richer(system)  # load-dependent shapes hold no force at the tip, and are good where it is smooth
    rungs += [family(x.n) for x in RUNGS if isinstance(x, LoadRitz) and family is not LoadRitz]
    apart = rungs[::4] + rungs[2::4] + rungs[1::2]  # far from one another first, for those who have little time
    uniform = [x for x in rungs if x.n and x.uniform]
    rungs = {named(basis): basis for basis in (system.basis, *uniform, *apart)}.values()
    scenes = [(basis, rung(system, basis)) for basis in rungs]
    worth = [(basis, solvers(scene)) for basis, scene in scenes]
    yield from (_Way(basis, best, "float64") for basis, (best, *_) in worth)
    narrow = [(basis, solvers(in_type("float32", scene))[0]) for basis, scene in scenes]
    yield from (_Way(basis, best, "float32") for basis, best in narrow if by_equal_steps(best))
    yield from (_Way(basis, other, "float64") for basis, (_, *others) in worth for other in others)
    yield from (_Way(basis, diffrax.Dopri8(), "float64") for basis, (best, *_) in worth if by_equal_steps(best))


def _measured(way: _Way, system, start, quantity, t0, ts, static: bool, true) -> list[Row]:
    """One way, with several steps: one compiled program."""
    scene, begin = brought(system, start, way.basis, static, t0)
    scene, begin, ts_ = in_type(way.dtype, (scene, begin, ts))
    solver, equal = way.solver, by_equal_steps(way.solver)
    if equal:
        plain = solve(scene, begin, t0=t0, ts=ts_, seldom=True)
        settings = sorted({max(ts.size, int(plain.stats["num_steps"] * x)) for x in _FRACTIONS})
    else:
        settings = _TOLERANCES

    @eqx.filter_jit
    def run(scene, begin, setting):
        adapt = {"stepsize_controller": diffrax.PIDController(rtol=setting, atol=setting)}
        how: dict[str, Any] = {"n_steps": setting} if equal else adapt
        sol = solve(scene, begin, t0=t0, ts=ts_, solver=solver, **how)
        return quantity(sol), sol.ok, sol.stats["num_steps"]

    rows, name = [], type(solver).__name__
    for setting in settings:
        setting = jnp.asarray(setting, way.dtype)
        value, ok, steps = jax.block_until_ready(run(scene, begin, setting))
        if not bool(ok):
            continue
        laps = []
        for _ in range(_REPEATS):
            lap = time.perf_counter()
            jax.block_until_ready(run(scene, begin, setting))
            laps.append(time.perf_counter() - lap)
        error = float(jnp.max(jnp.abs(value - true)))
        rows.append(Row(named(way.basis), name, way.dtype, int(steps), error, min(laps) / float(ts[-1] - t0)))
    return rows


def _reference(system, start, quantity, t0, ts, static: bool):
    """The answer, how far a poorer reference is from it, and its name."""
    exact = exact_answer(system, start, quantity, t0, ts, static, wanted=0.0, most=_MODES)
    if exact is not None and exact.complete:
        return exact.value, max(exact.apart, _KNOWN * float(np.max(np.abs(exact.value)))), "the exact rod"
    rungs = [richer(system)(n) for n in _BEST]
    poorer, best = (
        quantity(solve(*brought(system, start, padded(basis), static, t0), t0=t0, ts=ts, tolerance=_FINE, seldom=True))
        for basis in rungs
    )
    return best, float(jnp.max(jnp.abs(best - poorer))), named(rungs[-1])
