"""How long does a stage take?  For each kind of step, number of strain shapes and float type: what `jaxrod.plan` weighs by.

    python benchmarks/calibration.py

64 scenes side by side on one core, runs of two lengths: their difference over the difference of their stages.  Writes
jaxrod/stage_costs.json and the part "stages" of docs/accuracy_of_plans.md.
"""

import dataclasses
import json
import pathlib
import statistics
import time

import jaxrod

jaxrod.configure(devices=1)

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402

from jaxrod import cost  # noqa: E402

LANES, REPEATS = 64, 9
COUNTS = (1, 2, 3, 4, 6, 9)
ROOT = pathlib.Path(__file__).parent.parent
PAGE = ROOT / "docs" / "accuracy_of_plans.md"


def ways():
    """Kind of step, its solver and bases; the rod turns freely unless it is driven."""
    yield "flat", jaxrod.BlanesMoan6(), [jaxrod.Ritz(1)]
    yield "axial", jaxrod.ABA864(), [jaxrod.Ritz(0), jaxrod.ForceRitz(1), *map(jaxrod.LoadRitz, COUNTS[1:])]
    yield "prescribed", jaxrod.BlanesMoan6(), [jaxrod.Ritz(1), *map(jaxrod.LoadRitz, COUNTS[1:])]
    yield "adaptive", diffrax.Dopri8(), [jaxrod.Ritz(0), jaxrod.Ritz(1), jaxrod.LoadRitz(3), jaxrod.LoadRitz(6)]
    yield "condensed", diffrax.Dopri8(), [jaxrod.QuasiStatic(jaxrod.LoadRitz(2))]


def measured(kind: str, solver, basis, dtype: str) -> float:
    """Nanoseconds for each stage and lane."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    driven = jaxrod.scenes.steady(jnp.asarray(15.0))
    system = jaxrod.System(rod, driven if kind == "prescribed" else jaxrod.Rotation(), basis, gravity=9.81)
    moving = {} if kind == "prescribed" else {"rate": 15.0}
    system, start = jax.tree.map(
        lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, (system, system.state(**moving))
    )

    @jax.jit
    @jax.vmap
    def run(lane, size):
        given = {"n_steps": size} if kind in ("flat", "axial", "prescribed") else {}
        if not given:
            tolerance = jnp.asarray(1e-3 * size, dtype)
            given = {"stepsize_controller": diffrax.PIDController(rtol=tolerance, atol=tolerance)}
        begun = dataclasses.replace(start, amplitude_rates=start.amplitude_rates + 1e-2 * lane)
        sol = jaxrod.simulate(system, begun, t1=jnp.asarray(2.0, dtype), solver=solver, throw=False, **given)
        return sol.tip[-1], sol.stats["num_steps"]

    lanes, sizes = (
        jnp.arange(LANES, dtype=dtype) / LANES,
        (1.0, 1e-5) if kind in ("adaptive", "condensed") else (1e3, 3e3),
    )
    sizes = [jnp.full(LANES, size, dtype) for size in sizes]
    steps = [float(jnp.max(run(lanes, size)[1])) for size in sizes]
    laps = []
    for _ in range(REPEATS):
        seconds = []
        for size in sizes:
            begun = time.perf_counter()
            jax.block_until_ready(run(lanes, size))
            seconds.append(time.perf_counter() - begun)
        laps.append(seconds[1] - seconds[0])
    return 1e9 * statistics.median(laps) / (steps[1] - steps[0]) / cost.stages(solver) / LANES


def main() -> None:
    found: dict = {}
    for kind, solver, bases in ways():
        for dtype in ("float64", "float32"):
            found.setdefault(kind, {})[dtype] = [
                (basis.n, float(f"{measured(kind, solver, basis, dtype):.3g}")) for basis in bases
            ]
            print(kind, dtype, found[kind][dtype], flush=True)
    (ROOT / "jaxrod" / "stage_costs.json").write_text(
        json.dumps({"machine": report.machine(), "ns": found}, indent=1) + "\n", encoding="utf-8"
    )
    rows = [
        [kind, dtype, ", ".join(f"{n}: {ns:.3g}" for n, ns in counted)]
        for kind, types in found.items()
        for dtype, counted in types.items()
    ]
    head = (
        "## What a stage takes\n\n`python benchmarks/calibration.py`: nanoseconds for each stage and scene, 64 scenes side "
        "by side on one core, by the number of strain shapes.  jaxrod/stage_costs.json holds it for `jaxrod.plan`.\n\n"
    )
    report.write("stages", head + report.table(["step", "type", "shapes: ns"], rows), PAGE)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
