"""Are plans kept?  Random scenes, each planned for several tolerances, against a search of everything.

    python benchmarks/plan_coverage.py [coverage | beyond | refusals] --scenes 200 --seed 2

Kept: the planned run's error, from the exact rod with 256 modes, is no larger than the tolerance.  Cheapest: over all rungs to
24 shapes, solvers, float types and step counts (in factors of 1.6), stages x measured time of a stage, and what a scene takes
besides.  What meets a tolerance by luck does not count: a rung whose own error is beyond it, or that of a richer one, and
steps before which fewer were worse than their order explains.  Nothing is timed, so programs are compiled without
optimisation.

"coverage" draws scenes of all motions and searches the rungs that `plan` tries; "beyond" searches others besides.  "refusals"
draws rods that are let go, most of which are refused at the least tolerance, and searches for those alone.  Each writes its
part of docs/accuracy_of_plans.md.
"""

import argparse
import concurrent.futures
import itertools
import math
import multiprocessing
import os
import pathlib
import time
from typing import Any, NamedTuple

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")  # before JAX starts

import jaxrod

jaxrod.configure()

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402
from tqdm import tqdm  # noqa: E402

from jaxrod.accuracy import cost_model  # noqa: E402
from jaxrod.accuracy.ladder import on_rung  # noqa: E402
from jaxrod.accuracy.reference import apart  # noqa: E402
from jaxrod.core.precision import in_type  # noqa: E402
from jaxrod.runs.defaults import solvers  # noqa: E402

TOLERANCES = (1e-2, 1e-4, 1e-6)
MODES = 256  # of the exact rod; half of them tell how well it knows
RUNGS = [
    jaxrod.Ritz(0), jaxrod.QuasiStatic(jaxrod.LoadRitz(2)), jaxrod.Ritz(1), jaxrod.ForceRitz(1),
    *(jaxrod.LoadRitz(n) for n in (2, 3, 4, 6, 9, 12, 16, 24)),
]  # fmt: skip
OTHERS = [*(jaxrod.Ritz(n) for n in (2, 3, 4)), *(jaxrod.ForceRitz(n) for n in (2, 3, 4))]
PAGE = pathlib.Path(__file__).parent.parent / "docs" / "accuracy_of_plans.md"
MAPS = pathlib.Path("/proc/self/maps")
SOLVED = 1 / 3  # of a tolerance: the truth must be known better
FINER = 1.6
KINDS = ("rotation", "spherical", "flight", "driven")


class Drawn(NamedTuple):
    kind: str
    system: jaxrod.System
    start: Any
    t1: float
    quantity: Any


def drawn(kind: str, index: int, seed: int, released: float = 0.25) -> Drawn:
    """Stiff and soft cones, from a thousandth to a third of their critical spin, one to two hundred axial periods; a part of them
    let go from a stretch."""
    rng = np.random.default_rng((seed, KINDS.index(kind), index))
    ends = (jaxrod.FinalTip(), jaxrod.FinalAngle())
    quantity = jaxrod.LargestStrain() if kind == "driven" else ends[index % 2]
    tip = 0.02 * 2 ** rng.uniform(-1, 1)
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, tip), young=10 ** rng.uniform(6, 11), density=1200.0)
    first = 2 * np.pi * float(jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 1)[0])
    spin, t1 = first * 10 ** rng.uniform(-3, -0.5), 2 * np.pi / first * 10 ** rng.uniform(0, 2.3)
    gravity = 9.81 * (rng.uniform() < 0.5) if kind != "flight" else None
    if kind == "driven":
        system = jaxrod.System(rod, jaxrod.scenes.steady(jnp.asarray(spin)), jaxrod.Ritz(1), gravity)
        return Drawn(kind, system, system.state(), t1, quantity)
    motion = {"rotation": jaxrod.Rotation(), "spherical": jaxrod.Spherical(), "flight": jaxrod.Flight()}[kind]
    system = jaxrod.System(rod, motion, jaxrod.Ritz(1), gravity)
    more = {"azimuth_rate": spin * rng.uniform(0, 1)} if kind == "spherical" else {}
    stretched = 0.01 * (rng.uniform() < released)
    return Drawn(
        kind, system, system.state(angle=rng.uniform(-1, 1), rate=spin, strain=stretched, **more), t1, quantity
    )


def value(scene: Drawn, system, start, **how) -> tuple[np.ndarray, float]:
    """What is asked, NaN where the run does not reach its end, and the steps."""
    ts = scene.quantity.times(0.0, scene.t1).astype(start.direction.dtype)
    sol = jaxrod.simulate(system, start, ts=ts, throw=False, max_steps=2**24, **how)
    found = np.asarray(scene.quantity(sol), float)
    return np.where(bool(sol.ok), found, np.nan), float(sol.stats["num_steps"])


def exact(scene: Drawn, modes: int) -> np.ndarray:
    ts = scene.quantity.times(0.0, scene.t1)
    run = jaxrod.continuum.simulate(scene.system, scene.start, ts=ts, modes=modes, error=False)
    return np.asarray(scene.quantity(run), float)


def cheapest(scene: Drawn, truth, tolerances: tuple, others: list) -> dict[float, float]:
    """Of all ways, for each tolerance the least cost in s; inf where none does."""
    best = dict.fromkeys(tolerances, np.inf)
    rungs = []
    for basis in RUNGS + others:
        if scene.kind == "driven" and (isinstance(basis, jaxrod.QuasiStatic) or basis.n == 0):
            continue
        here = on_rung(scene.system, scene.start, basis)
        fine, fine_steps = value(scene, *here, tolerance=1e-11)
        rungs.append((basis, here, fine_steps, apart(fine, truth)))
    for k, (basis, here, fine_steps, own) in enumerate(rungs):
        family = [type(basis)] if basis in others else [jaxrod.QuasiStatic, jaxrod.LoadRitz]
        surest = max([own, *(error for richer, *_, error in rungs[k:] if type(richer) in family)])
        within = [tolerance for tolerance in tolerances if surest <= tolerance]
        if not within:
            continue
        for dtype in ("float64", "float32"):
            there = in_type(dtype, here)
            for solver in solvers(there[0]):
                search(scene, there, solver, fine_steps, truth, within, best)
    return best


def search(scene: Drawn, here: tuple, solver, fine_steps: float, truth, within: list, best: dict[float, float]) -> None:
    """More and more steps, until none can be cheaper than what was found."""
    system, start = here
    single = start.direction.dtype == jnp.float32
    saved, before = scene.quantity.times(0.0, 1.0).size, np.inf
    if isinstance(solver, diffrax.Dopri8):
        settings = [{"tolerance": 10.0**-k} for k in range(1, 6 if single else 13)]
    else:
        counts = saved * FINER ** np.arange(60)
        settings = [{"solver": solver, "n_steps": round(n)} for n in counts if n < max(10 * fine_steps, 2 * saved)]
    lost = 0
    for how in settings:
        spent = cost_model.seconds(system, solver, how.get("n_steps", 1))  # at the least: it may not be worth a run
        if all(spent > best[tolerance] for tolerance in within):
            return
        found, steps = value(scene, system, start, **how)
        error, spent = apart(found, truth), cost_model.seconds(system, solver, steps)
        for tolerance in within:
            if error <= tolerance and before <= FINER**3 * tolerance:
                best[tolerance] = min(best[tolerance], spent)
        lost = lost + 1 if error >= 0.9 * before else 0  # no longer the steps' error
        if lost > 4 and np.isfinite(error):
            return
        before = error


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", default="coverage", choices=WRITERS)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, help="of motion (default: all; let go, all but driven)")
    parser.add_argument("--minutes", type=float, default=math.inf, help="of each kind draw no more after so many")
    arguments = parser.parse_args()
    # A process for each kind of motion, whose scenes share compiled programs.
    pool = concurrent.futures.ProcessPoolExecutor(
        mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1
    )
    moving_freely = arguments.part == "refusals"  # driven rods begin at rest
    arguments.kinds = arguments.kinds or KINDS[: len(KINDS) - moving_freely]
    with pool:
        found = [*itertools.chain(*pool.map(looked_at, arguments.kinds, itertools.repeat(arguments)))]
    WRITERS[arguments.part](found, arguments)


class Looked(NamedTuple):
    """A plan, its true error, and the least cost of all; NaN where that was not searched for."""

    kind: str
    tolerance: float
    met: bool
    cost: float
    error: float
    least: float


def looked_at(kind: str, arguments) -> list[Looked]:
    """Of each scene of a kind and each tolerance the plan, its true error and the least cost."""
    refusals = arguments.part == "refusals"
    tolerances, released = (TOLERANCES[-1:], 1.0) if refusals else (TOLERANCES, 0.25)
    others = OTHERS if arguments.part == "beyond" else []
    found, begun = [], time.monotonic()
    for index in tqdm(
        range(-(-arguments.scenes // len(arguments.kinds))), kind, unit=" scenes", position=KINDS.index(kind)
    ):
        if time.monotonic() - begun > 60 * arguments.minutes:
            break
        scene = drawn(kind, index, arguments.seed, released)
        truth, check = exact(scene, MODES), exact(scene, MODES // 2)
        searched = None
        for tolerance in tolerances:
            if apart(truth, check) > SOLVED * tolerance:
                continue  # it cannot be told
            plan = jaxrod.plan(scene.system, scene.start, t1=scene.t1, tolerance=tolerance, quantity=scene.quantity)
            if not (refusals and plan.met):
                searched = cheapest(scene, truth, tolerances, others) if searched is None else searched
            least = np.nan if searched is None else searched[tolerance]
            error = apart(value(scene, scene.system, scene.start, plan=plan)[0], truth) if plan.met else np.nan
            found.append(Looked(kind, tolerance, plan.met, plan.cost, error, least))
            broken = plan.met and not (error <= tolerance and not plan.cost > 3 * least)
            if broken or (not plan.met and np.isfinite(least)):
                tqdm.write(f"{index} {kind} error {error:.1e}, least {1e6 * least:.3g} us: {plan}")
        if MAPS.exists() and MAPS.read_bytes().count(b"\n") > 55_000:
            jax.clear_caches()  # compiled programs are memory maps, of which there are 65,530
    return found


def coverage(found: list[Looked], arguments) -> None:
    text = (
        f"## Plans for random scenes\n\n`{said(arguments)}`: for 1e-2, 1e-4 and 1e-6 of tip, angle or (driven) largest strain. "
        "The error is from the exact rod with 256 modes, the cheapest from a search of the rungs that `plan` tries, all solvers, "
        "types and step counts.  Left out is what half the modes change by more than a third of the tolerance."
    )
    report.write("coverage", f"{text}\n\n{rows(found, arguments.kinds)}", PAGE)


def beyond(found: list[Looked], arguments) -> None:
    text = (
        f"## Against rungs that are not tried\n\n`{said(arguments)}`: the same, but the cheapest is sought among polynomials of "
        "strain and of force (2, 3, 4 of `Ritz` and `ForceRitz`) as well."
    )
    report.write("beyond", f"{text}\n\n{rows(found, arguments.kinds)}", PAGE)


def refusals(found: list[Looked], arguments) -> None:
    text = (
        f"## Refusals\n\n`{said(arguments)}`: rods let go from a stretch, for 1e-6 of tip or angle, which few rungs reach. A "
        "refusal is right where the search of the rungs that `plan` tries finds none either."
    )
    columns = ["scenes", "plans", "kept of the promised", "rightly refused"]
    lines = [
        [name, str(len(group)), kept(group), refused(group)]
        for name, group in [("all", found), *((kind, [x for x in found if x.kind == kind]) for kind in arguments.kinds)]
    ]
    report.write("refusals", f"{text}\n\n{report.table(columns, lines)}", PAGE)


WRITERS = {"coverage": coverage, "beyond": beyond, "refusals": refusals}


def said(arguments) -> str:
    part = "" if arguments.part == "coverage" else f" {arguments.part}"
    kinds = "" if len(arguments.kinds) == len(KINDS) else f" --kinds {' '.join(arguments.kinds)}"
    return f"python benchmarks/plan_coverage.py{part} --scenes {arguments.scenes} --seed {arguments.seed}{kinds}"


def rows(found: list[Looked], kinds: list[str]) -> str:
    lines = []
    groups = [("all", found)]
    groups += [(kind, [x for x in found if x.kind == kind]) for kind in kinds]
    groups += [(f"{tolerance:.0e}", [x for x in found if x.tolerance == tolerance]) for tolerance in TOLERANCES]
    for name, group in groups:
        met = [x for x in group if x.met]
        cheap = sum(x.cost <= 3 * x.least < np.inf for x in met)
        ratios = [x.cost / x.least for x in met if np.isfinite(x.least)]
        spread = f"{np.median(ratios):.2f}, {max(ratios):.1f}" if ratios else "-"
        lines.append([name, str(len(group)), kept(group), share(cheap, len(met)), spread, refused(group)])
    columns = [
        "scenes",
        "plans",
        "kept of the promised",
        "within 3x of the cheapest",
        "cost over it: median, most",
        "rightly refused",
    ]
    return report.table(columns, lines)


def kept(group: list[Looked]) -> str:
    met = [x for x in group if x.met]
    return share(sum(x.error <= x.tolerance for x in met), len(met))


def refused(group: list[Looked]) -> str:
    unmet = [x for x in group if not x.met]
    return share(sum(not np.isfinite(x.least) for x in unmet), len(unmet))


def share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.1f} %)" if whole else "-"


if __name__ == "__main__":
    main()
