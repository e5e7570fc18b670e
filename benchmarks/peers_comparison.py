"""What does a digit cost here, and what elsewhere?  Work against precision on the scene of the paper's Figure 2.

    python benchmarks/peers_comparison.py [--lanes 256] [--only heyoka_ c_kernel diffrax_]

Many starts (14 to 16 rad/s) for 10 s, 250 axial periods; the error is that of the worst tip against a Taylor series of
long doubles.  Each peer runs its settings from coarse to fine, the library through `sweep` and `simulate`.  Times are per
trajectory, the least of three runs, compile time apart.  A peer that is not installed is left out, and said so.  Writes the
part "peers" of docs/performance.md and docs/peers.png.
"""

import argparse
import importlib
import itertools
import math
import pathlib
import time

import jaxrod

jaxrod.configure(cache=None)

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from peers import Missing, Problem, reference  # noqa: E402

DURATION = 10.0
LEVELS = {1: (1e-3, 1e-5, 1e-7, 1e-9, 1e-11), 3: (1e-3, 1e-6, 1e-8, 1e-10)}


class Library:
    """`sweep` of `simulate` with n shapes, in float64 or float32, on `cores` devices, by the default solver or another one.
    A setting is a count of steps."""

    def __init__(self, n: int, dtype: str, cores: int, solver=None):
        self.name = f"jaxrod, {'default' if solver is None else type(solver).__name__}, {dtype}"
        self.n, self.dtype, self.cores, self.solver = n, dtype, cores, solver
        steps = (500, 700, 1000, 1400, 1750, 2200, 3000, 4400, 6400, 9000) if n == 1 else (
            300, 450, 700, 1000, 1400, 2000, 3000, 4500, 7000, 12000)  # fmt: skip
        if solver is not None:
            steps = (4000, 4600, 5600, 6600, 7700, 8800, 9700, 10700, 12000, 14500)
        self.settings = steps if dtype == "float64" else steps[:6]

    def compile(self, problem) -> float:
        rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
        system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(self.n), gravity=9.81)
        self.system = jax.tree.map(lambda x: x.astype(self.dtype), system)
        self.rates, self.programs = problem.rates.astype(self.dtype), {}
        return 0.0

    def run(self, setting):
        def tip(rate):
            start = self.system.state(rate=rate)
            solver = jaxrod.default_solver(self.system) if self.solver is None else self.solver
            end = jnp.asarray(DURATION, self.dtype)
            return jaxrod.simulate(self.system, start, t1=end, solver=solver, n_steps=setting, throw=False).tip[-1]

        fn = self.programs.setdefault(setting, tip)
        if fn is tip:  # the first time it compiles
            jaxrod.sweep(fn, self.rates, devices=self.cores, progress=False)
        began = time.perf_counter()
        tips = jaxrod.sweep(fn, self.rates, devices=self.cores, progress=False)
        return np.asarray(tips, float), time.perf_counter() - began


def contenders(n: int, names: list[str]):
    for dtype in ("float64", "float32"):
        for cores in (1, 2) if dtype == "float64" else (2,):
            yield lambda dtype=dtype, cores=cores: Library(n, dtype, cores)
    for solver in (jaxrod.QuinlanTremaine10(), jaxrod.QuinlanTremaine12()) if n == 1 else ():
        for cores in (1, 2):
            yield lambda cores=cores, solver=solver: Library(n, "float64", cores, solver)
    for name in names:
        module = importlib.import_module(f"peers.{name}")
        if name == "scipy_":
            for way in ("ode dop853", "solve_ivp DOP853", "odeint LSODA"):
                yield lambda module=module, way=way: module.SciPy(way)
            continue
        try:
            count = len(module.peers())
        except Missing as reason:
            print(f"left out: {name}: {reason}")
            continue
        for i in range(count):
            yield lambda module=module, i=i: module.peers()[i]
    if "c_kernel" in names:
        from peers.c_kernel import Kernel

        for cores in (1, 2):
            yield lambda cores=cores: Kernel(cores=cores, loops=True)


def curve(make, problem, target, most_seconds: float) -> tuple[str, int, list[tuple[float, float]]] | None:
    """Name, cores, and (error, microseconds) of each setting."""
    try:
        peer = make()
        peer.compile(problem)
        points, used = [], 0.0
        for setting in peer.settings:
            runs = [peer.run(setting)]
            if runs[0][1] < most_seconds / 20:
                runs += [peer.run(setting) for _ in range(4)]
            seconds = min(s for _, s in runs)
            error = float(np.nanmax(np.abs(runs[0][0] - target)))
            points.append((error, 1e6 * seconds / problem.lanes))
            used += sum(s for _, s in runs)
            if used > most_seconds:
                break
    except Missing as reason:
        print(f"left out: {reason}")
        return None
    print(f"n = {problem.n}, {peer.name}, {peer.cores} cores:", *(f"{e:.0e}/{t:.0f}us" for e, t in points), flush=True)
    return peer.name, peer.cores, points


def cost(points, level: float) -> float:
    """Least time of those at most as wrong as `level`, between settings by the straight line in the picture."""
    points = [(e, t) for e, t in points if math.isfinite(e)]
    best = min((t for e, t in points if e <= level), default=math.inf)
    for (e0, t0), (e1, t1) in itertools.pairwise(points):
        if e0 > level >= e1 > 0 and e0 < 1:
            share = math.log(e0 / level) / math.log(e0 / e1)
            best = min(best, t0 * (t1 / t0) ** share)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--lanes", type=int, default=512, help="trajectories; a multiple of 128 (default 512)")
    parser.add_argument("--seconds", type=float, default=12.0, help="for one peer at most (default 12)")
    parser.add_argument(
        "--only", nargs="*", default=["heyoka_", "c_kernel", "numba_", "diffrax_", "casadi_", "scipy_"], help="peers"
    )
    arguments = parser.parse_args()
    figure = Figure(figsize=(12, 8), layout="constrained")
    text = [
        "## Against others",
        "",
        "`python benchmarks/peers_comparison.py`: the Figure 2 scene, 10 s, microseconds per trajectory at the error of the "
        "tip (m) that was reached, worst of many starts; in brackets, that over the library's best on as many cores. The C "
        "kernels run three schemes, the library's default first: a block of 64 lanes in loops for `omp simd`, and one with its "
        "registers chosen by hand.",
    ]
    for n, axes in zip((1, 3), figure.subplots(1, 2), strict=True):
        problem = Problem.figure_2(n, np.linspace(14.0, 16.0, arguments.lanes))
        target = reference(problem)
        curves = [curve(make, problem, target, arguments.seconds) for make in contenders(n, arguments.only)]
        curves = [c for c in curves if c is not None and c[2]]
        own = [c for c in curves if c[0].startswith("jaxrod") and c[0].endswith("float64")]
        rows = []
        for name, cores, points in curves:
            cells = []
            for level in LEVELS[n]:
                time_here, time_ours = cost(points, level), min(cost(c[2], level) for c in own if c[1] == cores)
                cells.append(f"{time_here:.3g} ({time_here / time_ours:.2g})" if math.isfinite(time_here) else "-")
            rows.append([name, str(cores), *cells])
            style = {"lw": 2.5, "color": "black"} if name in [c[0] for c in own] else {"lw": 1}
            errors, times = zip(*((e, t) for e, t in points if math.isfinite(e) and e < 1), strict=True) if any(
                math.isfinite(e) and e < 1 for e, _ in points) else ((), ())  # fmt: skip
            axes.loglog(
                errors, times, ".--" if cores == 2 else ".-", label=f"{name}, {cores} core{'s' * (cores > 1)}", **style
            )
        axes.set(
            xlabel="error of the tip, m", ylabel="microseconds per trajectory", title=f"Ritz({n}), 10 s of Figure 2"
        )
        axes.invert_xaxis()
        axes.grid(alpha=0.3)
        axes.legend(fontsize=5.5, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
        text += ["", f"Ritz({n}), {arguments.lanes} trajectories:", ""]
        text += [report.table(["solver", "cores", *(f"{x:.0e}" for x in LEVELS[n])], rows)]
    figure.savefig(pathlib.Path(__file__).parent.parent / "docs" / "peers.png", dpi=130)
    report.write("peers", "\n".join([*text, "", "![Work against precision](peers.png)"]))


if __name__ == "__main__":
    main()
