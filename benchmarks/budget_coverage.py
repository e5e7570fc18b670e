"""Is the error that a run states the error that it has?

    python benchmarks/budget_coverage.py [--scenes 500] [--seed 1]

Random cones (1 : 3 to 3 : 1) turn, swing, fly and are driven (to 0.9 of the exact rod's critical rate) over up to 200
axial periods, on the rungs Ritz(1), Ritz(2) and LoadRitz(3).  The truth is LoadRitz(16) at tolerance 1e-12.  Inside: the
error is below the bound, or no bound was given.  Within ten: the bound is at most ten times the error, or below 1e-9 of
the quantity's scale, where the truth itself ends.  Writes the part "coverage" of docs/accuracy_of_budgets.md.
"""

import argparse
import pathlib

import jaxrod

jaxrod.configure()

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402

NAMES = ("largest strain", "angle", "tip, across", "tip, up")
RUNGS = {"Ritz(1)": jaxrod.Ritz(1), "Ritz(2)": jaxrod.Ritz(2), "LoadRitz(3)": jaxrod.LoadRitz(3)}
MOTIONS = ("rotation", "spherical", "flight", "driven")
TRUTH = jaxrod.LoadRitz(16)
SAVED = 100
PAGE = pathlib.Path(__file__).parent.parent / "docs" / "accuracy_of_budgets.md"


def scene(motion: str, basis, p):
    """A rod, its start and its end, from numbers between 0 and 1."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.02 * 3 ** (2 * p[0] - 1)), young=10 ** (6.5 + 2 * p[1]), density=1200.0)
    hinged = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(1))
    first = 2 * jnp.pi * jaxrod.continuum.natural_frequencies(hinged, 1)[0]
    spin, t1 = first * 0.3 * p[2], 2 * jnp.pi / first * 10 ** (2.3 * p[3])
    moving = {"angle": 2 * p[4] - 1, "rate": spin}
    if motion == "driven":
        given, moving = jaxrod.scenes.steady(0.9 * first * p[2]), {}
    elif motion == "spherical":
        given, moving = jaxrod.Spherical(), {**moving, "azimuth_rate": spin * p[5]}
    else:
        given = jaxrod.Rotation() if motion == "rotation" else jaxrod.Flight()
    system = jaxrod.System(rod, given, basis, gravity=9.81)
    return system, system.state(**moving, strain=0.02 * (p[6] - 0.5)), jnp.linspace(0.0, t1, SAVED + 1)[1:]


def asked(sol):
    return jnp.stack([jnp.max(jnp.abs(sol.strain)), sol.angle[-1], sol.tip[-1, 0], sol.tip[-1, -1]])


def one(motion: str, basis, p):
    system, start, ts = scene(motion, basis, p)
    quantity = jaxrod.Measured(asked, largest=jnp.array([jnp.inf, 4.0, 2.0, 2.0]))
    sol = jaxrod.simulate(system, start, ts=ts, budget=quantity, throw=False)
    system, start = jaxrod.ladder.on_rung(system, start, TRUTH)
    true = jaxrod.simulate(system, start, ts=ts, tolerance=1e-12, throw=False)
    return {"off": jnp.abs(sol.budget.value - asked(true)), "bound": sol.budget.bound, "ok": sol.ok & true.ok}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    each = -(-arguments.scenes // (len(MOTIONS) * len(RUNGS)))
    found = {}
    for motion in MOTIONS:
        for name, basis in RUNGS.items():
            numbers = jnp.asarray(rng.uniform(size=(each, 7)))
            found[motion, name] = jaxrod.sweep(lambda p, m=motion, b=basis: one(m, b, p), numbers, progress=False)
            print(motion, name, *judged([found[motion, name]])[1], flush=True)
    rows = []
    for label, picked in (
        *((motion, [x for (m, _), x in found.items() if m == motion]) for motion in MOTIONS),
        *((rung, [x for (_, r), x in found.items() if r == rung]) for rung in RUNGS),
        ("all", list(found.values())),
    ):
        count, shares = judged(picked)
        rows.append([label, str(count), *shares])
    head = (
        f"## Of random scenes\n\n`python benchmarks/budget_coverage.py --scenes {arguments.scenes} --seed "
        f"{arguments.seed}`: share of scenes whose error is inside the bound that the run states, of those where the bound is "
        "within ten times the error, and of those with no bound.\n\n"
    )
    head_row = ["scenes", "count", *(f"{name}: inside / within ten / no bound" for name in NAMES)]
    report.write("coverage", head + report.table(head_row, rows), PAGE)


def judged(found: list) -> tuple[int, list[str]]:
    off, bound, ok = (np.concatenate([np.asarray(x[name]) for x in found]) for name in ("off", "bound", "ok"))
    off, bound = off[ok], bound[ok]
    inside, bounded = off <= bound, np.isfinite(bound)
    tight = (bound <= 10 * off) | (bound < 1e-9)
    shares = []
    for k in range(len(NAMES)):
        within = tight[bounded[:, k], k].mean() if bounded[:, k].any() else np.nan
        shares.append(f"{100 * inside[:, k].mean():.0f} / {100 * within:.0f} / {100 * (~bounded[:, k]).mean():.0f} %")
    return int(ok.sum()), shares


if __name__ == "__main__":
    main()
