"""Is the error that a run states the error that it has?

    python benchmarks/budget_coverage.py [--scenes 576] [--seed 2]

Random cones (1 : 3 to 3 : 1) turn, swing, fly and are driven (to 0.9 of the exact rod's critical rate) over 1 to 200 axial
periods, on the rungs Ritz(1), Ritz(2), LoadRitz(3) and LoadRitz(6): from no strain, from uniform strain (up to 1 %; on a
`LoadRitz` rung its first shape), from the strain that the rung would hold at rest, and from no strain under a force along the
rod that comes at once (up to 1 % of strain at the tip).

The truth is the exact rod (`jaxrod.continuum.simulate`, which shares no code with the budget's runs) from the same field of
strain; what half its modes change is taken for its error.  The first frequency has the closed form of cones.

Scenes run one by one, as a user runs them, by programs that are compiled once for each motion and rung; motions side by
side.  Writes the part "coverage" of docs/accuracy_of_budgets.md.
"""

import argparse
import concurrent.futures
import multiprocessing
import os
import pathlib
import time
from typing import NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads make small matrices ten times as slow

import jaxrod

jaxrod.configure()

import equinox as eqx  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402

from jaxrod.continuum import closed_forms  # noqa: E402

NAMES = ("first frequency", "largest strain", "angle", "tip, across", "tip, up")
RUNGS = {
    "Ritz(1)": jaxrod.Ritz(1),
    "Ritz(2)": jaxrod.Ritz(2),
    "LoadRitz(3)": jaxrod.LoadRitz(3),
    "LoadRitz(6)": jaxrod.LoadRitz(6),
}
MOTIONS = ("rotation", "spherical", "flight", "driven")
STARTS = ("sudden", "stretched", "steady", "pulled")
MODES = 64
SAVED = 100
FLOOR = 1e-12  # of the number, or its unit: no bound is below it
TRUSTED = 0.1  # error of the truth over what it judges, at the most
PAGE = pathlib.Path(__file__).parent.parent / "docs" / "accuracy_of_budgets.md"


class Kind(NamedTuple):
    """What is compiled by itself."""

    motion: str
    rung: str
    begun: str


def scene(kind: Kind, p):
    """A rod, its start and its save times, from numbers p (7,) between 0 and 1."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.02 * 3 ** (2 * p[0] - 1)), young=10 ** (6.5 + 2 * p[1]), density=1200.0)
    first = jaxrod.continuum.critical_rate(jaxrod.System(rod, jaxrod.Rotation()))
    spin, t1 = 0.3 * p[2] * first, 200 ** p[3] * 2 * jnp.pi / first
    moving = {"angle": 2 * p[4] - 1, "rate": spin}
    if kind.motion == "driven":
        motion, moving = jaxrod.scenes.steady(0.9 * p[2] * first), {}
    elif kind.motion == "spherical":
        motion, moving = jaxrod.Spherical(), {**moving, "azimuth_rate": spin * p[5]}
    else:
        motion = jaxrod.Rotation() if kind.motion == "rotation" else jaxrod.Flight()
    pull = 0.02 * (p[6] - 0.5) * rod.young * rod.area(jnp.ones(1))[0]
    forces = [jaxrod.TipForce(pull)] if kind.begun == "pulled" else []
    system = jaxrod.System(rod, motion, RUNGS[kind.rung], gravity=9.81, forces=forces)
    start = system.state(**moving, strain=0.02 * (p[6] - 0.5) if kind.begun == "stretched" else 0.0)
    start = jaxrod.ladder.at_rest(system, start) if kind.begun == "steady" else start
    return system, start, jnp.linspace(0.0, t1, SAVED + 1)[1:]


def asked(sol) -> jax.Array:
    """Largest strain, angle (rad), tip across and up (m)."""
    quantities = (jaxrod.LargestStrain(), jaxrod.FinalAngle(), jaxrod.FinalTip())
    strain, angle, tip = (quantity(sol) for quantity in quantities)
    return jnp.stack([strain, angle, tip[0], tip[-1]])


@eqx.filter_jit
def exact(system, start, ts, modes: int):
    """The same of the exact rod with so many modes, and whether it reached its end."""
    sol = jaxrod.continuum.simulate(system, start, ts=ts, modes=modes, error=False)
    return asked(sol), sol.ok


def frequency(system) -> jax.Array:
    """The first of the exact cone in Hz, in closed form."""
    form = closed_forms.free_free if isinstance(system.motion, jaxrod.Flight) else closed_forms.held_free
    cone = system.rod.section
    return form(cone.root_radius, cone.tip_radius, 1)[0] * system.rod.wave_speed / (2 * jnp.pi * system.rod.length)


def one(kind: Kind, p) -> dict[str, np.ndarray]:
    """Of each quantity (5,) its `value`, `off`, the true error, its `bound`, and the error of the truth, `blur`; how it ended."""
    system, start, ts = scene(kind, jnp.asarray(p))
    own = jaxrod.CustomQuantity(asked, largest=jnp.array([jnp.inf, 4.0, 2.0, 2.0]))
    sol = jaxrod.simulate(system, start, ts=ts, budget=own, throw=False)
    true, ok = exact(system, start, ts, MODES)
    half, _ = exact(system, start, ts, MODES // 2)
    pitch = jaxrod.simulate(system, start, ts=ts, budget=jaxrod.FirstFrequency(), throw=False).budget
    both = {
        "value": (pitch.value, sol.budget.value),
        "off": (pitch.value - frequency(system), sol.budget.value - true),
        "bound": (pitch.bound, sol.budget.bound),
        "blur": (jnp.zeros(()), true - half),
    }
    found = {name: np.append(abs(np.asarray(a)), abs(np.asarray(b))) for name, (a, b) in both.items()}
    if kind.motion == "driven":
        found["off"][NAMES.index("angle")] = np.nan
    return {**found, "ok": np.asarray(sol.ok & ok)}


def look(kinds: list[Kind], each: int, seed: int) -> dict[Kind, dict[str, np.ndarray]]:
    """`each` scenes of every kind, (each, 5); prints what is judged and outside."""
    found = {}
    for kind in kinds:
        place = (MOTIONS.index(kind.motion), list(RUNGS).index(kind.rung), STARTS.index(kind.begun))
        rows = [one(kind, p) for p in np.random.default_rng([seed, *place]).uniform(size=(each, 7))]
        found[kind] = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
        v = verdict([found[kind]])
        ok = found[kind]["ok"]
        for i, k in np.argwhere(v["seen"] & ~(v["inside"] & v["within"])):
            off, bound = (found[kind][name][ok][i, k] for name in ("off", "bound"))
            print(*kind, f"{NAMES[k]}: error {off:.2e}, bound {bound:.2e}", flush=True)
        if kind.begun == STARTS[-1]:
            jax.clear_caches()  # compiled programs are memory maps, of which there are 65,530: one rung's at a time
    return found


def verdict(found: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Of each scene that ended ok and each quantity (N, 5): whether the error is `inside` its bound; the bound `within` ten
    times the error, or at the floor; whether there is no bound (`lost`); and whether there is one that the truth is good
    enough to judge (`seen`), or not (`blurred`)."""
    ok = np.concatenate([x["ok"] for x in found])
    value, off, bound, blur = (
        np.concatenate([x[name] for x in found])[ok] for name in ("value", "off", "bound", "blur")
    )
    lost = ~np.isnan(off) & ~np.isfinite(bound)
    bounded = ~np.isnan(off) & np.isfinite(bound)
    seen = bounded & (blur <= TRUSTED * np.fmax(off, bound))
    return {
        "inside": off <= bound,
        "within": (bound <= 10 * off) | (bound <= FLOOR * np.maximum(value, 1.0)),
        "lost": lost,
        "seen": seen,
        "blurred": bounded & ~seen,
    }


def judged(found: list[dict[str, np.ndarray]]) -> list[str]:
    """How many scenes ended ok, and of each quantity: percent inside, percent within ten, no bound, not judged."""
    v = verdict(found)
    shares = [f"{len(v['seen'])} of {sum(len(x['ok']) for x in found)}"]
    for k in range(len(NAMES)):
        seen, lost, blurred = (v[name][:, k] for name in ("seen", "lost", "blurred"))
        inside, within = (
            f"{100 * v[name][seen, k].mean():.1f}" if seen.any() else "–" for name in ("inside", "within")
        )
        shares.append(f"{inside} / {within} / {lost.sum()} / {blurred.sum()}")
    return shares


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--scenes", type=int, default=576, help="how many, over all kinds (default 576)")
    parser.add_argument("--seed", type=int, default=2, help="of the random numbers (default 2)")
    arguments, began = parser.parse_args(), time.perf_counter()
    each = -(-arguments.scenes // (len(MOTIONS) * len(RUNGS) * len(STARTS)))
    found = {}
    # A process each, as one cannot hold the programs of all.
    fresh = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(os.cpu_count(), fresh, max_tasks_per_child=1) as pool:
        kinds = [[Kind(motion, rung, begun) for rung in RUNGS for begun in STARTS] for motion in MOTIONS]
        for part in pool.map(look, kinds, [each] * len(kinds), [arguments.seed] * len(kinds)):
            found |= part
    rows = []
    for label in (*MOTIONS, *RUNGS, *STARTS, "all"):
        rows.append([label, *judged([x for kind, x in found.items() if label in (*kind, "all")])])
    text = (
        f"## Of random scenes\n\n`python benchmarks/budget_coverage.py --scenes {arguments.scenes} --seed {arguments.seed}`, "
        f"{(time.perf_counter() - began) / 60:.0f} min.  Percent of errors inside the bound / percent of bounds within ten "
        "times the error / how many had no bound / how many the truth is not good enough to judge.\n\n"
    )
    report.write("coverage", text + report.table(["scenes", "ended ok", *NAMES], rows), PAGE)


if __name__ == "__main__":
    main()
