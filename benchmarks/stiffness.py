"""What does stiffness cost, and what becomes of the energy?  Rubber to steel at equal error of angle and tip.

    python benchmarks/stiffness.py

The rod of Figure 2 started suddenly at 15 rad/s for 1 s, 64 lanes on one core; for each modulus the fewest steps of
`ABA864` and `StormerVerlet` with an error below 1e-6 of angle and tip.  Beside them the default, which keeps 1e-8 over
1,000 axial periods and so resolves each of them, and what `jaxrod.plan` finds for a tip good to 1e-6 m of the exact rod.
Then the energy of the default over 100 s of Figure 2, and over many axial periods.  Writes the part "stiffness" of
docs/performance.md.
"""

import argparse
from typing import Any

import jaxrod

jaxrod.configure(cache=None)

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402

from jaxrod.accuracy.run_plan import named  # noqa: E402

MATERIALS = {"rubber": (1e7, 1200.0), "nylon": (3e9, 1150.0), "aluminium": (7e10, 2700.0), "steel": (2e11, 7800.0)}
RATES = jnp.linspace(14.0, 16.0, 64)
COUNTS = [round(25 * 2 ** (k / 4)) for k in range(46)]


def program(n, young, density, solver, steps) -> Any:
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=young, density=density)
    system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81)

    def end(rate, steps):
        sol = jaxrod.simulate(system, system.state(rate=rate), t1=1.0, solver=solver, n_steps=steps, throw=False)
        return jnp.append(sol.tip[-1], sol.angle[-1])

    def search(rates):  # one program for all counts
        return jax.vmap(lambda rate: end(rate, steps))(rates)

    if steps:
        return search
    return jax.jit(jax.vmap(end, (0, None)), static_argnums=1)


def fewest(n, young, density, solver):
    """The least count of steps from which all larger ones tried are within 1e-6, the error there, and its run."""
    exact = np.asarray(program(n, young, density, jaxrod.ABA864(), 60_000)(RATES))
    best = None
    for steps in reversed(COUNTS):
        off = float(np.max(np.abs(np.asarray(program(n, young, density, solver, steps)(RATES)) - exact)))
        if not off < 1e-6:
            break
        best = (steps, off)
    if best is None:
        return None
    end = program(n, young, density, solver, 0)
    return (*best, lambda: jax.block_until_ready(end(RATES, best[0])))


def left_to_the_library(young, density):
    """The default, and the plan for 1e-6 m of the exact rod's tip: steps, what steps them, and the run."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=young, density=density)
    system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81)

    def run(**how):
        end = jax.jit(jax.vmap(lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=1.0, **how).tip[-1]))
        return lambda: jax.block_until_ready(end(RATES))

    steps = int(jaxrod.simulate(system, system.state(rate=15.0), t1=1.0).stats["num_steps"])
    yield "the default", f"{type(jaxrod.default_solver(system)).__name__}, Ritz(1)", steps, run()
    plan = jaxrod.plan(system, system.state(rate=16.0), t1=1.0, tolerance=1e-6)
    if plan.met:
        yield "as planned", f"{type(plan.solver).__name__}, {named(plan.basis)}", plan.n_steps, run(plan=plan)
    else:
        yield "as planned", "cannot be met", 0, None


def drift(t1, saves, n=1, **options):
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81)
    sol = jaxrod.simulate(
        system, system.state(rate=15.0), ts=jnp.linspace(0.0, t1, saves + 1), max_steps=2**30, **options
    )
    off = np.asarray(sol.energy / sol.energy[0]) - 1
    half = off.size // 2
    return np.max(np.abs(off)), np.mean(off[half:]) - np.mean(off[:half]), int(sol.stats["num_steps"])


def unasked() -> list[list[str]]:
    rows = []
    for material, (young, density) in MATERIALS.items():
        found = list(left_to_the_library(young, density))
        times = report.paired({what: run for what, *_, run in found if run is not None}, 7)
        for what, way, steps, run in found:
            spent = "-" if run is None else f"{1e6 * times[what] / 64:.1f}"
            rows.append([material, what, way, str(steps) if steps else "-", spent])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--periods", type=float, default=1e6, help="axial periods of the long run (default 10^6)")
    periods = parser.parse_args().periods
    rows = []
    for n in (1, 3):
        runs, notes = {}, {}
        for name, (young, density) in MATERIALS.items():
            best = [(fewest(n, young, density, s), type(s).__name__) for s in (jaxrod.ABA864(), jaxrod.StormerVerlet())]
            if n == 1:
                best.append((fewest(n, young, density, jaxrod.BlanesMoan6()), "BlanesMoan6"))
            for found, solver in best:
                if found is not None:
                    runs[(name, solver)], notes[(name, solver)] = found[2], found[:2]
        times = report.paired(runs, 7)
        least = {name: min((t, solver) for (m, solver), t in times.items() if m == name) for name in MATERIALS}
        for name, (t, solver) in least.items():
            steps, off = notes[(name, solver)]
            rows.append(
                [
                    f"Ritz({n})",
                    name,
                    solver,
                    str(steps),
                    f"{off:.0e}",
                    f"{1e6 * t / 64:.1f}",
                    f"{t / least['rubber'][0]:.1f}",
                ]
            )
    text = [
        "## Stiffness", "", "`python benchmarks/stiffness.py`: 1 s from a sudden start at 15 rad/s, the cheapest that keeps "
        "angle and tip to 1e-6.", "",
        report.table(["rod", "material", "solver", "steps", "error", "us per trajectory", "over rubber"], rows), "",
        "Left to the library, a scene of the same kind, its tip good to 1e-6 m of the exact rod as planned, to 1e-8 of this "
        "rung by default:", "", report.table(["material", "asked of", "takes", "steps", "us per trajectory"], unasked()), "",
        "## Energy of the default", "",
    ]  # fmt: skip
    rows = []
    for name, t1, saves, n in (("100 s of Figure 2", 100.0, 1000, 1), ("100 s, Ritz(3)", 100.0, 1000, 3),
                               (f"{periods:.0e} axial periods", periods * 2 * np.pi / 144.3, 1000, 1)):  # fmt: skip
        largest, trend, steps = drift(t1, saves, n)
        rows.append([name, f"{steps:,}", f"{largest:.1e}", f"{trend:+.1e}"])
    text.append(report.table(["run", "steps", "largest error of the energy", "mean of second half less first"], rows))
    report.write("stiffness", "\n".join(text))


if __name__ == "__main__":
    main()
