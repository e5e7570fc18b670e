"""What does a digit cost here, and what elsewhere?  Work against precision on the scene of the paper's Figure 2.

    python benchmarks/peers_comparison.py [--lanes 1024] [--only heyoka_ c_kernel diffrax_]

Many starts (14 to 16 rad/s) for 10 s, 250 axial periods; the error is that of the worst tip against a Taylor series of
long doubles (without heyoka against DOP853, good to 3e-12); SciPy and CasADi run a few of the starts.  Each peer runs its
settings from coarse to fine, the library through `sweep` and `simulate`.  The curves are the least of five runs, of slow
peers one; what has a floor is then measured again in turns, medians of seven.  Compile time is apart.  A peer that is not
installed is left out, and said so.  Writes the part "peers" of docs/performance.md and docs/peers.png.
"""

import argparse
import importlib
import itertools
import math
import pathlib
import statistics
import time
from typing import Any, NamedTuple

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


class Floor(NamedTuple):
    """So many times faster than a peer, on as many cores, at an error; `ours`: the one to compare, None for the best."""

    n: int
    error: float
    peer: str
    times: float
    ours: str | None = None


OWN = {1: "jaxrod, BlanesMoan6, float64", 3: "jaxrod, ABA864, float64"}
FLOORS = [
    Floor(1, 1e-7, "heyoka, batch", 5.0),
    Floor(1, 1e-11, "heyoka, batch", 2.0),
    Floor(1, 1e-7, "Diffrax, best, Dopri8, blocks", 30.0),
    Floor(1, 1e-7, "C, Blanes-Moan 6, float64, loops", 0.8, OWN[1]),
    Floor(1, 1e-7, "C, Blanes-Moan 6, float64", 0.8, OWN[1]),
    Floor(3, 1e-6, "heyoka, batch", 8.0),
]


class Library:
    """`sweep` of `simulate` with n shapes, in float64 or float32, on `cores` devices.

    A setting is a count of steps of the default solver or another one, or the `tolerance` that counts them.
    """

    def __init__(self, n: int, dtype: str, cores: int, solver=None, *, by_tolerance: bool = False):
        self.n, self.dtype, self.cores, self.solver, self.by_tolerance = n, dtype, cores, solver, by_tolerance
        own = OWN[n].split(", ")[1] if solver is None else type(solver).__name__
        self.name = f"jaxrod, {'tolerance=' if by_tolerance else own}, {dtype}"
        steps = (500, 700, 1000, 1400, 1750, 2200, 3000, 4400, 6400, 9000) if n == 1 else (
            300, 450, 700, 1000, 1400, 2000, 3000, 4500, 7000, 12000)  # fmt: skip
        if solver is not None:
            steps = (4000, 4600, 5600, 6600, 7700, 8800, 9700, 10700, 12000, 14500)
        self.settings = steps if dtype == "float64" else steps[:6]
        if by_tolerance:
            self.settings = tuple(10.0**-k for k in range(3, 13))

    def compile(self, problem) -> float:
        rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
        system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(self.n), gravity=9.81)
        self.system = jax.tree.map(lambda x: x.astype(self.dtype), system)
        self.rates, self.programs = problem.rates.astype(self.dtype), {}
        began = time.perf_counter()
        self.run(self.settings[0])
        return time.perf_counter() - began

    def run(self, setting):
        solver = jaxrod.default_solver(self.system) if self.solver is None else self.solver
        how: dict[str, Any] = {"tolerance": setting} if self.by_tolerance else {"solver": solver, "n_steps": setting}

        def tip(rate):
            start, end = self.system.state(rate=rate), jnp.asarray(DURATION, self.dtype)
            return jaxrod.simulate(self.system, start, t1=end, throw=False, **how).tip[-1]

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
    for cores in (1, 2):
        yield lambda cores=cores: Library(n, "float64", cores, by_tolerance=True)
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


class Curve(NamedTuple):
    """A peer, the seconds of what it does once, and (error, microseconds) of each of its settings."""

    peer: Any
    once: float
    points: list[tuple[float, float]]

    def within(self, error: float) -> list[tuple[float, Any]]:
        """Microseconds and settings of what is at most so wrong."""
        return [(t, setting) for (e, t), setting in zip(self.points, self.peer.settings, strict=False) if e <= error]


def curve(make, problem, target, most_seconds: float) -> Curve | None:
    try:
        peer = make()
        once, points, used = peer.compile(problem), [], 0.0
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
    return Curve(peer, once, points)


def in_turns(floor: Floor, curves: list[Curve], lanes: int) -> list[str] | None:
    """What a floor asks for and what is found, by the cheapest settings that are as good, run one after the other."""
    able = [c for c in curves if c.peer.cores == 2 and c.within(floor.error)]
    peers = [c for c in able if c.peer.name == floor.peer]
    ours = [c for c in able if isinstance(c.peer, Library) and floor.ours in (None, c.peer.name)]
    if not peers or not ours:
        return None
    best = min(ours, key=lambda c: min(c.within(floor.error)))
    spent: list[list[float]] = [[], []]
    for _ in range(7):
        for times, one in zip(spent, (best, peers[0]), strict=True):
            times.append(one.peer.run(min(one.within(floor.error))[1])[1])
    ratio, (a, b) = statistics.median(spent[1]) / statistics.median(spent[0]), map(sorted, spent)
    shown = [f"{1e6 * x[3] / lanes:.3g} ({1e6 * x[1] / lanes:.3g} to {1e6 * x[5] / lanes:.3g})" for x in (a, b)]
    met = "yes" if ratio >= floor.times else "**no**"
    name = best.peer.name.removesuffix(", float64")
    return [f"Ritz({floor.n}), {floor.error:.0e}", name, floor.peer, *shown, f"{ratio:.2f}", f"{floor.times:g}", met]


def registers(problem) -> list[str]:
    """What the compiler made of the C kernels, each by a line."""
    from peers.c_kernel import Kernel

    lines = []
    for dtype, loops in itertools.product(("float64", "float32"), (False, True)):
        try:
            kernel = Kernel(dtype=dtype, loops=loops)
            kernel.compile(problem)
            lines.append(f"- {kernel.vector_registers()}")
        except (Missing, RuntimeError) as reason:
            lines.append(f"- {reason}")
    return lines


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
    parser.add_argument("--lanes", type=int, default=1024, help="trajectories; a multiple of 128 (default 1024)")
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
        "tip (m) that was reached, worst of many starts; in brackets, that over the library's best on as many cores; `-`: not "
        "reached by the settings that had time. The library by `tolerance=` counts its own steps; elsewhere `n_steps=` is "
        "given, as a user would who has measured. The C kernels run three schemes, the library's default first: a block of 64 "
        "lanes in loops for `omp simd`, and one with its registers chosen by hand.",
    ]
    floors = []
    for n, axes in zip((1, 3), figure.subplots(1, 2), strict=True):
        problem = Problem.figure_2(n, np.linspace(14.0, 16.0, arguments.lanes))
        target = reference(problem)
        curves = [curve(make, problem, target, arguments.seconds) for make in contenders(n, arguments.only)]
        curves = [c for c in curves if c is not None and c.points]
        own = [c for c in curves if isinstance(c.peer, Library) and c.peer.dtype == "float64"]
        floors += [row for floor in FLOORS if floor.n == n and (row := in_turns(floor, curves, problem.lanes))]
        rows = []
        for peer, once, points in curves:
            name, cores, cells = peer.name, peer.cores, []
            for level in LEVELS[n]:
                time_here, time_ours = (
                    cost(points, level),
                    min(cost(c.points, level) for c in own if c.peer.cores == cores),
                )
                cells.append(f"{time_here:.3g} ({time_here / time_ours:.2g})" if math.isfinite(time_here) else "-")
            rows.append([name, str(cores), *cells, f"{once:.1f}"])
            style = {"lw": 2.5, "color": "black"} if name in [c.peer.name for c in own] else {"lw": 1}
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
        text += [report.table(["solver", "cores", *(f"{x:.0e}" for x in LEVELS[n]), "once, s"], rows)]
        if n == 1 and "c_kernel" in arguments.only:
            text += ["", *registers(problem)]
    head = ["error", "ours", "against", "ours, us (middle five)", "theirs, us", "times as fast", "asked", "met"]
    text += ["", "In turns on two cores, medians of seven:", "", report.table(head, floors)]
    figure.savefig(pathlib.Path(__file__).parent.parent / "docs" / "peers.png", dpi=130)
    report.write("peers", "\n".join([*text, "", "![Work against precision](peers.png)"]))


if __name__ == "__main__":
    main()
