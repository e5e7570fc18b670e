"""What does a digit cost?  Solvers x tolerances x float32/float64 on the scene of the paper's Figure 2.

    python benchmarks/speed_accuracy.py [--seconds 10] [--repeats 25] [--out docs]

Each row is one scene, run alone: error of the tip against the reference, and computing time per simulated second, as
the least of repeats taken in turn: other work on the machine only ever adds.  Times are ratios to the library's default.
Compile time is apart; what a call takes before its first step is not, and is said.  Writes speed_accuracy.md and
speed_accuracy.png to the folder.

The reference at t = 10 s comes from a Taylor series of 45 digits, checked by Gragg-Bulirsch-Stoer extrapolation; at
other times, and to the check that every row must pass before it is timed, from the default at tolerance 1e-12.
"""

import argparse
import datetime
import importlib.metadata
import pathlib
import platform
import time
from collections.abc import Callable
from typing import NamedTuple

import jaxrod

jaxrod.configure(cache=None)

import diffrax  # noqa: E402
import jax  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

REFERENCE = {10.0: (146.434545534944, 0.00856831368328735)}  # psi in rad, eps


class Method(NamedTuple):
    """A line of the picture: its name, type, and a run for each of its settings."""

    name: str
    dtype: str
    settings: tuple[float, ...]
    options: Callable[[float], dict]


class Row(NamedTuple):
    method: str
    dtype: str
    setting: float
    error: float
    steps: int
    compiling: float
    running: float


def by_tolerance(solver, chart):
    """A Diffrax solver with its own kind of step size control: the same relative and absolute tolerance for all."""

    def options(tolerance):
        return {
            "solver": solver,
            "chart": chart,
            "stepsize_controller": diffrax.PIDController(rtol=tolerance, atol=tolerance),
        }

    return options


def methods() -> list[Method]:
    """What is compared."""
    angles, embedded = jaxrod.Angles(), jaxrod.Embedded()
    rough, fine = (1e-4, 1e-6, 1e-8), (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
    return [
        Method("default", "float64", (1e-4, 1e-6, 1e-8, 1e-10, 1e-12), lambda tolerance: {"tolerance": tolerance}),
        Method("default", "float32", (1e-2, 1e-3, 1e-4), lambda tolerance: {"tolerance": tolerance}),
        Method(
            "default, Embedded", "float64", (1e-4, 1e-6, 1e-8, 1e-10), lambda t: {"tolerance": t, "chart": embedded}
        ),
        Method("Tsit5, Angles", "float64", fine, by_tolerance(diffrax.Tsit5(), angles)),
        Method("Dopri5, Angles", "float64", fine, by_tolerance(diffrax.Dopri5(), angles)),
        Method("Dopri8, Angles", "float64", fine, by_tolerance(diffrax.Dopri8(), angles)),
        Method("Dopri8, Embedded", "float64", fine, by_tolerance(diffrax.Dopri8(), embedded)),
        Method("Kvaerno5, Angles", "float64", rough, by_tolerance(diffrax.Kvaerno5(), angles)),
        Method("Tsit5, Angles", "float32", (1e-3, 1e-4, 1e-5), by_tolerance(diffrax.Tsit5(), angles)),
        Method("Dopri8, equal steps", "float64", (800, 1600, 3200, 6400), lambda n: {"n_steps": int(n)}),
    ]


def scene(dtype: str):
    system = jaxrod.paper.corrected()
    start = system.state(angle=0.0, rate=jaxrod.paper.SPIN)
    return jax.tree.map(lambda x: x.astype(dtype), (system, start))


def tip(angle, strain):
    return (1 + strain) * np.stack([np.cos(angle), np.sin(angle)])


def exact(seconds: float):
    if seconds in REFERENCE:
        return tip(*(np.asarray(x) for x in REFERENCE[seconds]))
    system, start = scene("float64")
    run = jaxrod.simulate(system, start, t1=seconds, tolerance=1e-12)
    return tip(np.asarray(run.angle[-1]), np.asarray(run.strain[-1]))


def runner(method: Method, setting: float, seconds: float):
    system, start = scene(method.dtype)
    options = method.options(setting)
    return lambda: jax.block_until_ready(jaxrod.simulate(system, start, t1=seconds, throw=False, **options))


def measure(seconds: float, repeats: int) -> list[Row]:
    """Errors first, then times, all settings in turn."""
    target, runs, rows = exact(seconds), {}, []
    for method in methods():
        for setting in method.settings:
            run = runner(method, setting, seconds)
            begin = time.perf_counter()
            solution = run()
            compiling = time.perf_counter() - begin
            if solution.result != jaxrod.Result.ok:
                print(f"left out: {method.name}, {method.dtype}, {setting:g}: {jaxrod.Result[solution.result]}")
                continue
            reached = tip(np.asarray(solution.angle[-1], float), np.asarray(solution.strain[-1], float))
            error = float(np.max(np.abs(reached - target)))
            rows.append(
                Row(method.name, method.dtype, setting, error, int(solution.stats["num_steps"]), compiling, 0.0)
            )
            runs[len(rows) - 1] = run
    times = {index: [] for index in runs}
    for _ in range(repeats):
        for index, run in runs.items():
            begin = time.perf_counter()
            run()
            times[index].append(time.perf_counter() - begin)
    return [row._replace(running=min(times[index])) for index, row in enumerate(rows)]


def call(repeats: int) -> float:
    """What the default takes in s where there is next to nothing to compute."""
    run, times = runner(methods()[0], 1e-8, 1e-3), []
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return min(times)


def table(rows: list[Row], seconds: float) -> str:
    default = next(row for row in rows if (row.method, row.dtype, row.setting) == ("default", "float64", 1e-8))
    lines = [
        "| method | type | setting | error of the tip, m | steps / s | ms / s | time / default | first call, s |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        lines.append(
            f"| {row.method} | {row.dtype} | {row.setting:g} | {row.error:.1e} | {row.steps / seconds:.0f} "
            f"| {1e3 * row.running / seconds:.2f} | {row.running / default.running:.2f} | {row.compiling:.1f} |"
        )
    return "\n".join(lines)


def at_equal_error(rows: list[Row], errors=(1e-6, 1e-8, 1e-10)) -> str:
    """Time over the default's at the same achieved error, interpolated along each line; blank where it does not reach."""
    lines_of: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        lines_of.setdefault((row.method, row.dtype), []).append(row)

    def cost(line, error):
        points = sorted((np.log(row.error), np.log(row.running)) for row in line if row.error > 0)
        xs, ys = zip(*points, strict=True)
        return np.exp(np.interp(np.log(error), xs, ys)) if xs[0] <= np.log(error) <= xs[-1] else None

    default = lines_of["default", "float64"]
    out = [
        f"| method | type | {' | '.join(f'error {error:.0e}' for error in errors)} |",
        "| --- | --- |" + " ---: |" * len(errors),
    ]
    for (name, dtype), line in lines_of.items():
        cells = []
        for error in errors:
            own, base = cost(line, error), cost(default, error)
            cells.append(f"{own / base:.2f}" if own and base else "")
        out.append(f"| {name} | {dtype} | {' | '.join(cells)} |")
    return "\n".join(out)


def picture(rows: list[Row], seconds: float) -> Figure:
    figure = Figure(figsize=(9.5, 5.0), layout="constrained")
    axis = figure.subplots()
    names = list(dict.fromkeys((row.method, row.dtype) for row in rows))
    for number, (name, dtype) in enumerate(names):
        line = sorted(
            (row.error, 1e3 * row.running / seconds) for row in rows if (row.method, row.dtype) == (name, dtype)
        )
        errors, times = zip(*line, strict=True)
        style = {"color": "black", "linewidth": 2.2} if name == "default" else {"color": f"C{number}", "linewidth": 1.1}
        marker, dash = ("s", "--") if dtype == "float32" else ("o", "-")
        axis.loglog(errors, times, dash, marker=marker, markersize=4, label=f"{name}, {dtype}", **style)
    axis.set_xlabel("error of the tip at the end, m (length 1 m)")
    axis.set_ylabel("computing time per simulated second, ms")
    axis.set_title(f"Figure 2's scene, {seconds:g} s: what a digit costs", fontsize=11)
    axis.invert_xaxis()
    axis.grid(alpha=0.3)
    figure.legend(fontsize=8, loc="outside right center")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description="Speed for accuracy on the scene of the paper's Figure 2.")
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time (default 10)")
    parser.add_argument("--repeats", type=int, default=25, help="timed runs of each row (default 25)")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("docs"), help="folder to write (default docs)")
    arguments = parser.parse_args()
    rows = measure(arguments.seconds, arguments.repeats)
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("jax", "diffrax", "equinox"))
    text = "\n\n".join(
        [
            "# Speed for accuracy",
            "Written by `python benchmarks/speed_accuracy.py`: the scene of the paper's Figure 2 (corrected), "
            f"{arguments.seconds:g} s, one scene at a time, the least of {arguments.repeats} runs taken in turn. "
            f"{datetime.date.today()}, Python {platform.python_version()}, {versions}, {platform.machine()}. "
            f"A call takes {1e3 * call(arguments.repeats):.1f} ms before its first step, which is in all of them; a sweep pays "
            "that once. The machine is shared and noisy: compare ratios.",
            "![Error against computing time](speed_accuracy.png)",
            "## Time over the default's at equal achieved error",
            at_equal_error(rows),
            "## All runs",
            "Steps and milliseconds per simulated second.",
            table(rows, arguments.seconds),
        ]
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "speed_accuracy.md").write_text(text + "\n", encoding="utf-8")
    picture(rows, arguments.seconds).savefig(arguments.out / "speed_accuracy.png", dpi=130)
    print(text)


if __name__ == "__main__":
    main()
