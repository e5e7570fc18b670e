"""How long does a stage take, and a scene besides?  For each kind of step, shapes and float type: what `jaxrod.plan` weighs by.

    python benchmarks/calibration.py

64 scenes side by side on one core, equal steps in runs of few and of many: what the second take longer, over the
stages that they have more.  What a scene takes besides, to begin, to save and to be judged, is what a run of few steps of
rigid rods takes without them, 1,024 side by side.  Writes jaxrod/accuracy/stage_costs.json and the part "stages" of
docs/accuracy_of_plans.md.
"""

import dataclasses
import json
import math
import pathlib
import time
from typing import Any

import jaxrod

jaxrod.configure(devices=1)

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import report  # noqa: E402

from jaxrod.accuracy import cost_model  # noqa: E402
from jaxrod.core.precision import in_type  # noqa: E402

LANES, REPEATS = 64, 9
MANY, FEW_STEPS = 1024, (50, 250)
COUNTS = (2, 3, 4, 6, 9)
STEPS = (2000, 6000)
ROOT = pathlib.Path(__file__).parent.parent
PAGE = ROOT / "docs" / "accuracy_of_plans.md"


def ways():
    """Kind of step, its solver and bases; the rod turns freely unless it is driven."""
    richer = [jaxrod.LoadRitz(n) for n in COUNTS]
    yield "flat", jaxrod.BlanesMoan6(), [jaxrod.Ritz(1)]
    yield "multistep", jaxrod.QuinlanTremaine12(), [jaxrod.Ritz(1)]
    yield "axial", jaxrod.ABA864(), [jaxrod.Ritz(0), jaxrod.ForceRitz(1), *richer]
    yield "prescribed", jaxrod.BlanesMoan6(), [jaxrod.Ritz(1), *richer]
    yield "adaptive", diffrax.Dopri8(), [jaxrod.Ritz(0), jaxrod.Ritz(1), jaxrod.LoadRitz(3), jaxrod.LoadRitz(6)]
    yield "condensed", diffrax.Dopri8(), [jaxrod.QuasiStatic(jaxrod.LoadRitz(2))]


def nanoseconds(kind: str, solver: Any, basis: Any, dtype: str) -> float:
    """Of a stage, for each lane."""
    steps, least = laps(kind, solver, basis, dtype, STEPS, LANES)
    return 1e9 * (least[-1] - least[-2]) / (steps[-1] - steps[-2]) / cost_model.stages(solver) / LANES


def besides(dtype: str) -> float:
    """Nanoseconds of a scene without its steps."""
    (_, few, more), (_, short, longer) = laps("axial", jaxrod.ABA864(), jaxrod.Ritz(0), dtype, FEW_STEPS, MANY)
    return 1e9 * (short - few * (longer - short) / (more - few)) / MANY


def laps(kind: str, solver: Any, basis: Any, dtype: str, counts: tuple[int, int], many: int) -> tuple[list, list]:
    """Steps taken and seconds: of nothing, then of each count (adaptive solvers take as many as they like)."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    driven = kind == "prescribed"
    motion = jaxrod.scenes.steady(jnp.asarray(15.0)) if driven else jaxrod.Rotation()
    system = jaxrod.System(rod, motion, basis, gravity=9.81)
    system, start = in_type(dtype, (system, system.state() if driven else system.state(rate=15.0)))
    adapts = kind in ("adaptive", "condensed")

    @jax.jit
    @jax.vmap
    def run(lane, size):
        how = {} if adapts else {"n_steps": size}
        begun = dataclasses.replace(start, amplitude_rates=start.amplitude_rates + 1e-2 * lane)
        begun = dataclasses.replace(begun, direction_rate=begun.direction_rate * (1 + 1e-2 * lane * (not driven)))
        sol = jaxrod.simulate(system, begun, t1=jnp.asarray(2.0, dtype), solver=solver, throw=False, **how)
        return sol.tip[-1], sol.stats["num_steps"]

    lanes = jnp.arange(many, dtype=dtype) / many
    sizes = [jnp.full(many, size, dtype) for size in (counts[:1] if adapts else counts)]
    steps = [0.0, *(float(jnp.max(run(lanes, size)[1])) for size in sizes)]
    least = [0.0, *(math.inf for _ in sizes)]  # what a busy machine adds is no part of it
    for _ in range(REPEATS):
        for k, size in enumerate(sizes, 1):
            begun = time.perf_counter()
            jax.block_until_ready(run(lanes, size))
            least[k] = min(least[k], time.perf_counter() - begun)
    return steps, least


def main() -> None:
    found: dict[str, dict[str, list]] = {}
    for kind, solver, bases in ways():
        for dtype in ("float64",) if kind in ("flat", "multistep") else ("float64", "float32"):
            counted = [(basis.n, float(f"{nanoseconds(kind, solver, basis, dtype):.3g}")) for basis in bases]
            found.setdefault(kind, {})[dtype] = counted
            print(kind, dtype, counted, flush=True)
    scene = {dtype: float(f"{besides(dtype):.3g}") for dtype in ("float64", "float32")}
    print("scene", scene, flush=True)
    table = json.dumps({"machine": report.machine(), "scene": scene, "ns": found}, indent=1)
    (ROOT / "jaxrod" / "accuracy" / "stage_costs.json").write_text(table + "\n", encoding="utf-8")
    rows = [
        [kind, dtype, ", ".join(f"{n}: {ns:.3g}" for n, ns in counted)]
        for kind, types in found.items()
        for dtype, counted in types.items()
    ]
    rows += [["a scene besides", dtype, f"{ns:.3g}"] for dtype, ns in scene.items()]
    head = (
        "## What a stage takes\n\n`python benchmarks/calibration.py`: nanoseconds for each stage and scene, 64 scenes side "
        "by side on one core, by the number of strain shapes; and what a scene takes besides its steps. "
        "jaxrod/accuracy/stage_costs.json holds them for `jaxrod.plan`.\n\n"
    )
    report.write("stages", head + report.table(["step", "type", "shapes: ns"], rows), PAGE)


if __name__ == "__main__":
    main()
