"""How does the cost grow?  With scenes, horizon, strain shapes, save points, cores, rods that differ, friction; and the
memory of a large sweep.

    python benchmarks/scaling.py [--most 1000000]

Figure 2 through `sweep`, errors as said.  Medians of runs in turn.  Writes the part "scaling" of docs/performance.md.
"""

import argparse
import dataclasses
import resource
import time

import jaxrod

jaxrod.configure(cache=None)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402

ROD = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)


def scene(n=1, motion=None, t1=10.0, steps=1750, saves=1, rod=ROD):
    """A function of the rate for `sweep`: tip and result."""
    system = jaxrod.System(rod, motion or jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81)
    solver, ts = jaxrod.default_solver(system), np.linspace(0.0, t1, saves + 1)[1:]

    def fn(rate):
        start = system.state(rate=rate)
        sol = jaxrod.simulate(system, start, ts=jnp.asarray(ts), solver=solver, n_steps=steps)
        return {"tip": sol.tip[-1], "highest": sol.tip[:, 1].max(), "result": sol.result}

    return fn


def own_rods(n, steps):
    """Figure 2 with a modulus of its own for each scene: nothing of the rod is known to the compiler."""

    def fn(rate):
        rod = dataclasses.replace(ROD, young=1e7 * rate / 15)
        return scene(n, steps=steps, rod=rod)(rate)

    return fn


def damped(n, **how):
    """A second of Figure 2 with friction at the pivot and in the rod."""
    forces = [jaxrod.PivotFriction(0.3), jaxrod.KelvinVoigt(1e-4)]
    system = jaxrod.System(ROD, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81, forces=forces)
    return lambda rate: {"tip": jaxrod.simulate(system, system.state(rate=rate), t1=1.0, **how).tip[-1]}


def rates(count):
    return np.linspace(14.0, 16.0, count)


def error(fn, fine, count=64):
    """Of the tip against the same scene with many more steps."""
    return float(np.max(np.abs(jaxrod.sweep(fn, rates(count))["tip"] - jaxrod.sweep(fine, rates(count))["tip"])))


def run(fn, count, **options):
    return lambda: jaxrod.sweep(fn, rates(count), progress=False, **options)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--most", type=int, default=1_000_000, help="scenes of the largest sweep (default 10^6)")
    most = parser.parse_args().most
    text = [
        "## How the cost grows",
        "",
        "`python benchmarks/scaling.py`: Figure 2 for 10 s through `sweep`, all cores.",
    ]

    # Scenes: a short run, so that a million of them take minutes.
    short, rows = scene(t1=1.0, steps=175), []
    jaxrod.sweep(short, rates(1000))
    for count in (100, 1000, 10_000, 100_000, most):
        seconds = []
        for _ in range(5 if count <= 10_000 else 1):
            began = time.perf_counter()
            jaxrod.sweep(short, rates(count), progress=False)
            seconds.append(time.perf_counter() - began)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows.append((count, 1e6 * float(np.median(seconds)) / count, peak))
    thousand = next(r for r in rows if r[0] == 1000)
    cells = [[f"{c:,}", f"{t:.2f}", f"{t / thousand[1]:.2f}", f"{p - thousand[2]:+.0f}"] for c, t, p in rows]
    head = ["scenes of 1 s", "us per scene", "over 1,000", "peak memory over that at 1,000, MB"]
    text += ["", report.table(head, cells)]

    # Cores.
    long = scene()
    times = report.paired({"1": run(long, 2048, devices=1), "all": run(long, 2048)}, 7)
    text += ["", f"All cores against one: {times['1'] / times['all']:.2f} times as fast (2,048 scenes of 10 s)."]

    # Motion and shapes, at equal error of 1e-6.
    kinds = {
        "Ritz(1), plane": (scene(steps=1250), scene(steps=6000)),
        "Ritz(1), space": (scene(motion=jaxrod.Spherical(), steps=1250), scene(motion=jaxrod.Spherical(), steps=6000)),
        "Ritz(2), plane": (scene(2, steps=1250), scene(2, steps=6000)),
        "Ritz(3), plane": (scene(3, steps=1300), scene(3, steps=6000)),
        "Ritz(5), plane": (scene(5, steps=1900), scene(5, steps=6000)),
    }
    times = report.paired({name: run(fn, 1024) for name, (fn, _) in kinds.items()}, 9)
    cells = [
        [name, f"{error(*kinds[name]):.0e}", f"{1e6 * t / 1024:.0f}", f"{t / times['Ritz(1), plane']:.2f}"]
        for name, t in times.items()
    ]
    text += ["", report.table(["scene of 10 s", "error, m", "us per scene", "over Ritz(1) in the plane"], cells)]

    # Rods that differ.
    pairs = {}
    for n, steps in ((1, 1250), (3, 1300)):
        pairs |= {f"Ritz({n}), one rod": scene(n, steps=steps), f"Ritz({n}), a modulus each": own_rods(n, steps)}
    times = report.paired({name: run(fn, 1024) for name, fn in pairs.items()}, 9)
    cells = [
        [name, f"{1e6 * t / 1024:.0f}", f"{t / times[name.split(',')[0] + ', one rod']:.2f}"]
        for name, t in times.items()
    ]
    text += ["", report.table(["starts that differ, 10 s", "us per scene", "over one rod"], cells)]

    # Friction.
    cells = []
    for n, steps in ((1, 1500), (3, 4000)):
        ways = {
            "the default": damped(n),
            f"Unrolled, {steps} steps": damped(n, solver=jaxrod.Unrolled(), n_steps=steps),
        }
        exact = damped(n, tolerance=1e-12)
        times = report.paired({name: run(fn, 128) for name, fn in ways.items()}, 3)
        for name, t in times.items():
            cells.append(
                [
                    f"Ritz({n})",
                    name,
                    f"{error(ways[name], exact):.0e}",
                    f"{1e6 * t / 128:.0f}",
                    f"{t / times['the default']:.2f}",
                ]
            )
    head = ["1 s with friction", "solver", "error, m", "us per scene", "over the default"]
    text += ["", report.table(head, cells)]

    # Save points and horizon.
    saves = {f"{k:,} saved": scene(steps=2000, saves=k) for k in (1, 10, 100, 1000)}
    times = report.paired({name: run(fn, 512) for name, fn in saves.items()}, 9)
    cells = [[name, f"{1e6 * t / 512:.0f}", f"{t / times['1 saved']:.2f}"] for name, t in times.items()]
    spans = {f"{t1:g} s": scene(t1=t1, steps=int(175 * t1)) for t1 in (1.0, 10.0, 100.0)}
    times = report.paired({name: run(fn, 256) for name, fn in spans.items()}, 3)
    cells += [[name, f"{1e6 * t / 256:.0f}", f"{t / times['1 s']:.2f}"] for name, t in times.items()]
    text += ["", report.table(["10 s of 2,000 steps; horizons at one step", "us per scene", "over the first"], cells)]
    report.write("scaling", "\n".join(text))


if __name__ == "__main__":
    main()
