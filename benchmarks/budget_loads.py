"""Is the error that a loaded run states the error that it has?

    python benchmarks/budget_loads.py [--scenes 208] [--seed 1] [--kinds ...]

The scenes of random_loads.py: forces, laws, tables, steps, bodies at the tip, pivots, gravity vectors, starts at t0, records
and blows.  Each runs as a user runs it, with a budget of the tip, the angle and the largest strain.

The truth is the same scene with 16 strain shapes, by Dopri8 in other coordinates at a tolerance of 1e-10, its blow given as an
`Impulse`; what it differs by from 10 shapes is taken for its error.  A number that lies on this side of its bound or on the
other, as that error has it, is not judged.  Writes the part "loads" of docs/accuracy_of_budgets.md.
"""

import argparse
import concurrent.futures
import multiprocessing
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads make small matrices ten times as slow

import jaxrod

jaxrod.configure()

import diffrax  # noqa: E402
import equinox as eqx  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import random_loads  # noqa: E402
import report  # noqa: E402
from budget_coverage import PAGE  # noqa: E402

RANGE = np.array([np.inf, 4.0, 2.0, 2.0])  # of each number, a quarter of which is a lost phase
NAMES = ("largest strain", "angle", "tip, across", "tip, up")
SHAPES = (10, 16)  # of what the truth is held against, and of the truth
TIGHT = 1e-10
MOST_STEPS = 2**16


def asked(sol) -> jax.Array:
    """Largest strain, angle (rad), tip across and up over the length."""
    strain, angle, tip = (
        quantity(sol) for quantity in (jaxrod.LargestStrain(), jaxrod.FinalAngle(), jaxrod.FinalTip())
    )
    tip = tip / sol.system.rod.length
    return jnp.stack([strain, angle, tip[0], tip[-1]])


@eqx.filter_jit
def truth(kind, p, n: int):
    """What is `asked` of the scene with n shapes, and whether it reached its end."""
    system, start = kind.build(p, random_loads.blow("impulse", p), kind.forces)
    system, start = jaxrod.ladder.on_rung(system, start, jaxrod.ladder.richer(system)(n))
    tight = diffrax.PIDController(rtol=TIGHT, atol=TIGHT, pcoeff=0.2, icoeff=0.4)
    sol = jaxrod.simulate(
        system, start, t0=p["t0"], ts=times(p), solver=diffrax.Dopri8(), stepsize_controller=tight, chart=kind.chart,
        max_steps=MOST_STEPS, throw=False,
    )  # fmt: skip
    return asked(sol), sol.ok


def times(p):
    return p["t0"] + p["duration"] * jnp.linspace(0.0, 1.0, random_loads.SAVED + 1)[1:]


def one(kind, p) -> dict[str, np.ndarray]:
    """Of each quantity `off`, the true error, its `bound`, and the error of the truth, `blur`; how it ended."""
    system, start = kind.build(p, random_loads.blow(kind.form, p), kind.forces)
    own = jaxrod.CustomQuantity(asked, largest=jnp.asarray(RANGE))
    with report.quiet():
        sol = jaxrod.simulate(system, start, t0=p["t0"], ts=times(p), budget=own, throw=False)
        (half, _), (true, ok) = (truth(kind, p, n) for n in SHAPES)
    found = {"off": sol.budget.value - true, "bound": sol.budget.bound, "blur": true - half}
    found = {name: abs(np.asarray(x)) for name, x in found.items()}
    if isinstance(system.motion, jaxrod.Driven):
        found["off"][NAMES.index("angle")] = np.nan
    return {**found, "ok": np.asarray(sol.ok & ok)}


def look(index: int, each: int, seed: int) -> dict[str, np.ndarray]:
    """`each` scenes of one kind, (each, 4); prints what is judged and outside, and how long it took."""
    began, kind = time.perf_counter(), random_loads.KINDS[index]
    p = random_loads.draw(each, np.random.default_rng([seed, index]))
    rows = []
    for k in range(each):
        try:
            rows.append(one(kind, {name: jnp.asarray(x[k]) for name, x in p.items()}))
        except ValueError as refused:  # samples closer than the digits of their stamps
            print(f"   {kind.name}, scene {k}: {refused}", flush=True)
            rows.append({"ok": np.asarray(False)} | dict.fromkeys(("off", "bound", "blur"), np.full(4, np.nan)))
    found = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    v, ok = verdict([found]), found["ok"]
    for i, k in np.argwhere(v["seen"] & ~v["inside"]):
        off, bound = (found[name][ok][i, k] for name in ("off", "bound"))
        print(
            f"   {kind.name}, scene {np.flatnonzero(ok)[i]}, {NAMES[k]}: error {off:.2e}, bound {bound:.2e}", flush=True
        )
    print(f"{kind.name}: {time.perf_counter() - began:.0f} s", " | ".join(judged([found])), flush=True)
    return found


def verdict(found: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Of each scene that ended ok and each quantity (N, 4): whether it has no bound (`lost`), though its error is less than a
    tenth of the range (`needless`), whether the error of the truth decides whether it is inside (`blurred`), and where that is
    `seen`, whether it is `inside`."""
    ok = np.concatenate([x["ok"] for x in found])
    off, bound, blur = (np.concatenate([x[name] for x in found])[ok] for name in ("off", "bound", "blur"))
    asked, inside = ~np.isnan(off), off + blur <= bound
    bounded = asked & np.isfinite(bound)
    seen = bounded & (inside | (off - blur > bound))
    lost = asked & ~bounded
    return {
        "lost": lost,
        "needless": lost & (off < RANGE / 10),
        "asked": asked,
        "blurred": bounded & ~seen,
        "seen": seen,
        "inside": inside,
    }


def judged(found: list[dict[str, np.ndarray]]) -> list[str]:
    """How many scenes ended ok; of each quantity percent inside; percent that have a bound, of those whose error is less than a
    tenth of the range; how many others have none; how many are not judged."""
    v = verdict(found)
    shares = [f"{len(v['seen'])} of {sum(len(x['ok']) for x in found)}"]
    for k in range(len(NAMES)):
        seen, lost, needless, blurred, asked = (v[x][:, k] for x in ("seen", "lost", "needless", "blurred", "asked"))
        inside = f"{100 * v['inside'][seen, k].mean():.1f}" if seen.any() else "–"
        rightly = lost.sum() - needless.sum()
        bounded = f"{100 * (1 - needless.sum() / max(asked.sum() - rightly, 1)):.1f}"
        shares.append(f"{inside} / {bounded} / {rightly} / {blurred.sum()}")
    return shares


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--scenes", type=int, default=208, help="how many, over all kinds (default 208)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    parser.add_argument("--kinds", default="", help="only those whose name holds this")
    arguments, began = parser.parse_args(), time.perf_counter()
    each = -(-arguments.scenes // len(random_loads.KINDS))
    kinds = [k for k, kind in enumerate(random_loads.KINDS) if arguments.kinds in kind.name]
    fresh = multiprocessing.get_context("spawn")  # a process each, as one cannot hold the programs of all
    with concurrent.futures.ProcessPoolExecutor(os.cpu_count(), fresh, max_tasks_per_child=1) as pool:
        found = list(pool.map(look, kinds, [each] * len(kinds), [arguments.seed] * len(kinds)))
    rows = [[random_loads.KINDS[k].name, *judged([x])] for k, x in zip(kinds, found, strict=True)]
    rows.append(["all", *judged(found)])
    text = (
        f"## Of random loads\n\n`python benchmarks/budget_loads.py --scenes {arguments.scenes} --seed {arguments.seed}`, "
        f"{(time.perf_counter() - began) / 60:.0f} min.  Percent of errors inside the bound / percent that have a bound, of "
        "those whose error is less than a tenth of the range / how many others have none / how many the truth is not good "
        "enough to judge.\n\n"
    )
    if not arguments.kinds:
        report.write("loads", text + report.table(["scenes", "ended ok", *NAMES], rows), PAGE)


if __name__ == "__main__":
    main()
