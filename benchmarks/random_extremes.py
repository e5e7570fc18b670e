"""Is the library ever silently wrong?  Random extreme scenes, float64 and float32, each against half the step in float64.

    python benchmarks/random_extremes.py [--scenes 20000] [--seed 1]

Moduli of 1e3 to 1e15 Pa, lengths of 1e-9 to 1e6 m, stiffness over weight of 1e-3 to 1e12 or no weight, radius ratios to 1e3
and points both ways, bodies at the tip to 1e6 rod masses, spin to 3 times critical, starts at the poles, strains that
collapse, up to 200 periods of the fastest of these.  All numbers are rounded to float32 first, so that both types compute
the same scene.

A scene is *silently wrong* if it ends ok and yet its tip is off by more than the promise of `tolerance` (1e-8 of the
largest distance from the pivot, at least the length; float32 1e-4, and 6e-7 for each radian turned), or its energy or
angular momentum by more than ten times that. Where two runs apart by 1e-12, in float32 by the rounding of their steps
(1.2e-7 times the root of the number of their stages), differ by more than the promise no solver can keep it: the scene is
*beyond its horizon*, and counted apart; it is measured on runs whose places, rates, and gravity and modulus are moved, and
by a third of the step beside half of it, as rounding may be worst where no start is near.  Nor is that judged for which half
the step in float64 takes too many steps: *unjudged*. Writes the part "random" of docs/extremes.md.
"""

import argparse
import dataclasses
import pathlib
import time
from typing import Any, NamedTuple

import jaxrod

jaxrod.configure()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402

from jaxrod import Result  # noqa: E402
from jaxrod.core.precision import in_type  # noqa: E402

PAGE = pathlib.Path(__file__).parent.parent / "docs" / "extremes.md"
DENSITY = 1000.0
PROMISE = {"float64": 1e-8, "float32": 1e-4}
ROUNDING = {"float64": 2.2e-16, "float32": 1.2e-7}  # of a stage
STAGES = 14  # of a step, at most
APART = 1e-12  # of two starts, the distance that `jaxrod.horizon` takes
EACH_RADIAN = {"float64": 0.0, "float32": 6e-7}
LONGEST = 2**14  # steps
CLEAR = 1 / 3  # of the promise: two runs with finer steps must agree to so much
SHIFT = 1e-9  # of the start, to see how distances grow
CODES = tuple(code.name for code in Result if code != Result.unseen)  # nothing here depends on time


class Kind(NamedTuple):
    """Scenes of one structure, which share a compiled program."""

    motion: str
    n: int

    def __str__(self):
        return f"{self.motion}, Ritz({self.n})"


KINDS = [
    Kind("Rotation", 0), Kind("Rotation", 1), Kind("Rotation", 3), Kind("Rotation inside", 3), Kind("Spherical", 0),
    Kind("Spherical", 1), Kind("Spherical", 3), Kind("Flight", 1), Kind("Flight", 3), Kind("Driven", 1), Kind("Driven", 3),
]  # fmt: skip


def draw(kind: Kind, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """`count` random extreme scenes of a kind: the numbers that `scene` takes."""

    def decades(low, high):
        return 10.0 ** rng.uniform(low, high, count)

    def sometimes(chance, value, other):
        return np.where(rng.random(count) < chance, value, other)

    ratio = decades(-3, 3)
    ratio = sometimes(0.1, 0.0, ratio)  # a pointed tip
    root = 1.0 if kind.motion == "Rotation" else sometimes(0.1 if kind.motion == "Flight" else 0.0, 0.0, 1.0)
    ratio = np.where((ratio == 0) & (root == 0), 1.0, ratio)
    sign = rng.choice([-1.0, 1.0], count)
    return {
        "young": decades(3, 15),
        "length": decades(-9, 6),
        "stiffness_over_weight": sometimes(0.15, np.inf, decades(-3, 12)),
        "slenderness": decades(1, 4),
        "root": root * np.ones(count),
        "tip": ratio,
        "tip_mass": sometimes(0.4, 0.0, decades(-3, 6)),
        "pivot": rng.uniform(0.05, 0.95, count),
        "angle": sometimes(0.2, rng.choice([-np.pi / 2, np.pi / 2, 0.0], count), rng.uniform(-np.pi, np.pi, count)),
        "spin": sometimes(0.1, 0.0, sign * decades(-3, 0.5)),  # over the first axial rate
        "azimuth_spin": sometimes(0.3, 0.0, sign * decades(-3, 0.5)),
        "strain": sometimes(0.3, 0.0, rng.uniform(-0.7, 0.7, count)),
        "strain_rate": sometimes(0.3, 0.0, rng.choice([-1.0, 1.0], count) * decades(-3, 0.5)),  # over the axial rate
        "periods": decades(-1, 2.3),
    }


def scene(kind: Kind, p: dict) -> tuple[jaxrod.System, jaxrod.State, jax.Array]:
    """System, start and save times, in float64 of numbers that float32 has too."""
    length, unit = p["length"], p["length"] / p["slenderness"] / jnp.maximum(1.0, p["tip"])
    section = jaxrod.Cone(_single(p["root"] * unit), _single(p["tip"] * unit))
    mass = jaxrod.Rod(_single(length), section, _single(p["young"]), DENSITY).mass
    rod = jaxrod.Rod(
        _single(length), section, _single(p["young"]), jnp.asarray(DENSITY), tip_mass=_single(p["tip_mass"] * mass)
    )
    pinned = {"pivot": _single(p["pivot"] * length)} if kind.motion == "Rotation inside" else {}
    gravity = _single(p["young"] / (DENSITY * length * p["stiffness_over_weight"]))
    kinds: dict[str, Any] = {
        "Rotation": jaxrod.Rotation,
        "Rotation inside": jaxrod.Rotation,
        "Spherical": jaxrod.Spherical,
    }
    kinds |= {"Flight": jaxrod.Flight}
    moving: Any = jaxrod.Rotation() if kind.motion == "Driven" else kinds[kind.motion](**pinned)
    own = jaxrod.Ritz(kind.n) if kind.n else jaxrod.LoadRitz(1)
    rate = 2 * jnp.pi * jaxrod.natural_frequencies(jaxrod.System(rod, moving, own))[0]
    spin = _single(p["spin"] * rate)
    if kind.motion == "Driven":
        moving = jaxrod.scenes.steady(spin)
    system = jaxrod.System(rod, moving, jaxrod.Ritz(kind.n), gravity)
    numbers: dict[str, Any] = {} if kind.motion == "Driven" else {"angle": _single(p["angle"]), "rate": spin}
    if kind.n:
        numbers |= {"strain": _single(p["strain"]), "strain_rate": _single(p["strain_rate"] * rate)}
    if kind.motion == "Spherical":
        numbers |= {"azimuth_rate": _single(p["azimuth_spin"] * rate)}
    # Periods of the fastest of vibration, turning and swing, whichever the scene is about.
    swing = (
        0.0
        if kind.motion == "Flight"
        else gravity * jnp.abs(system.body.first_moments[0]) / system.body.mass_matrix[0, 0]
    )
    fastest = jnp.sqrt(rate**2 + spin**2 + swing)
    ts = _single(jnp.linspace(0.0, 1.0, 21)[1:] * p["periods"] * 2 * jnp.pi / fastest)
    return system, system.state(**numbers), ts


def _single(x):
    return jnp.asarray(x, jnp.float32).astype(jnp.float64)


def _place(sol) -> jax.Array:
    """Of the tip from the pivot, in flight from the centre of mass, over the length."""
    system = sol.system
    return jax.vmap(system.body.reach)(sol.states.amplitudes)[:, None] * sol.states.direction / system.rod.length


def yardstick(kind: Kind, p: dict) -> tuple[dict, dict]:
    """One scene in float64: what was found, and what a run of half the step says for either type."""
    system, start, ts = scene(kind, p)
    double = jaxrod.simulate(system, start, ts=ts, max_steps=LONGEST)
    steps = double.stats["num_steps"]
    finer = jaxrod.simulate(system, start, ts=ts, n_steps=jnp.maximum(2 * steps, 1), max_steps=2 * LONGEST)
    finest = jaxrod.simulate(system, start, ts=ts, n_steps=jnp.maximum(3 * steps, 1), max_steps=3 * LONGEST)
    right = _place(finer)
    size = jnp.maximum(jnp.max(jnp.linalg.norm(right, axis=-1)), 1.0)  # a heavy tip stays beside the centre of mass
    known = {
        "right": right,
        "size": size,
        "finer": finer.result,
        "blur": jnp.max(jnp.linalg.norm(_place(finest) - right, axis=-1)) / size,
        "place": _place(double),
        "steps": steps,
        "turned": jnp.mean(jnp.linalg.norm(finer.states.direction_rate, axis=-1)) * ts[-1],
    }
    return _found(double, known), known


def growth(kind: Kind, p: dict, known: dict) -> jax.Array:
    """How much further apart two runs get than they were set: by places, by rates, or by what the scene is made of."""
    system, start, ts = scene(kind, p)
    of: Any = system
    unit = ts[-1] / p["periods"] / (2 * jnp.pi)
    places = _moved(_moved(start, "direction", SHIFT), "amplitudes", SHIFT)
    rates = _moved(_moved(start, "direction_rate", SHIFT / unit), "amplitude_rates", SHIFT / unit)
    faster = dataclasses.replace(start, direction_rate=(1 + SHIFT) * start.direction_rate)
    rod = dataclasses.replace(of.rod, young=of.rod.young * (1 + SHIFT))
    other = dataclasses.replace(system, rod=rod, gravity=of.gravity * (1 - SHIFT))
    steps, furthest = jnp.maximum(known["steps"], 1), []
    # One by one: moved together, they may undo each other.
    for scene_, shifted in ((system, places), (system, rates), (other, faster)):
        run = jaxrod.simulate(scene_, shifted, ts=ts, n_steps=steps, max_steps=LONGEST)
        furthest.append(jnp.max(jnp.linalg.norm(_place(run) - known["place"], axis=-1)))
    return jnp.max(jnp.stack(furthest)) / known["size"] / SHIFT


def single(kind: Kind, p: dict, known: dict) -> dict:
    """The same scene in float32."""
    system, start, ts = scene(kind, p)
    run = jaxrod.simulate(*in_type(jnp.float32, (system, start)), ts=ts.astype(jnp.float32), max_steps=LONGEST)
    return _found(run, known)


def _found(run, known: dict) -> dict:
    """Its code, the error of its tip, and its ledger."""
    book = run.ledger
    kept = [x for x in (book.energy, book.angular_momentum) if x is not None]
    return {
        "result": run.result,
        "error": jnp.max(jnp.linalg.norm(_place(run) - known["right"], axis=-1)) / known["size"],
        "kept": jnp.max(jnp.stack(kept)) if kept else jnp.zeros(()),
        "room": book.room,
        "largest_strain": book.largest_strain,
        "steps": run.stats["num_steps"],
        "finer": known["finer"],
        "blur": known["blur"],
        "turned": known["turned"],
    }


def look(kind: Kind, p: dict) -> dict[str, dict]:
    """Many scenes in both types, in a program each: what `verdict` takes."""

    def each(fn, *inputs) -> Any:
        return jaxrod.sweep(lambda x: fn(kind, *x), inputs, order_by=p["periods"], progress=False)

    with report.quiet():
        double, known = each(yardstick, p)
        grown = each(growth, p, known)
        half = each(single, p, known)
    return {name: {**found, "growth": grown} for name, found in (("float64", double), ("float32", half))}


def _moved(state, part, by):
    moved = getattr(state, part) + by
    if part == "direction":
        moved = moved / jnp.linalg.norm(moved)
    if part == "direction_rate":
        moved = moved - (moved @ state.direction) * state.direction
    values = {name: getattr(state, name) for name in state.__dataclass_fields__}
    return jaxrod.State(**{**values, part: moved})


def verdict(name: str, found: dict) -> dict[str, np.ndarray]:
    """For each scene, whether it is `ok`, `beyond` its horizon, and silently `wrong`."""
    found = {key: np.asarray(x) if key in ("result", "finer") else np.asarray(x, float) for key, x in found.items()}
    ok = found["result"] == Result.ok
    promise = PROMISE[name] + EACH_RADIAN[name] * np.nan_to_num(found["turned"])  # not known of what is not judged
    apart = np.maximum(ROUNDING[name] * np.sqrt(STAGES * np.maximum(found["steps"], 1)), APART)  # each rounds anew
    judged = found["finer"] != Result.max_steps
    beyond = ok & ~((found["growth"] * apart <= promise) & (found["blur"] <= CLEAR * promise))
    off = judged & ~(found["error"] <= promise)
    wrong = ok & ((off & ~beyond) | ~(found["kept"] <= 10 * promise))
    return {
        "ok": ok,
        "unjudged": ok & ~judged,
        "beyond": beyond & judged,
        "wrong": wrong,
        "margin": found["error"] / promise,
        "kept": found["kept"] / promise,
    }


def _shown(value) -> str:
    return Result[value].split(":")[0] if value.dtype == np.int8 else f"{float(value):.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--scenes", type=int, default=20000, help="how many, over all kinds (default 20000)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    parser.add_argument("--kinds", default="", help="only those whose name holds this")
    parser.add_argument("--show", type=int, default=3, help="offenders to print of each kind and type (default 3)")
    arguments = parser.parse_args()
    rng, began = np.random.default_rng(arguments.seed), time.perf_counter()
    kinds = [kind for kind in KINDS if arguments.kinds in str(kind)]
    each, rows, totals = -(-arguments.scenes // len(kinds)), [], {name: [0, 0, 0] for name in PROMISE}
    for kind in kinds:
        p = draw(kind, each, rng)
        out = look(kind, p)
        jax.clear_caches()  # of another kind nothing is needed again, and memory maps are few
        for name, found in out.items():
            seen = verdict(name, found)
            counts = {code: int(np.sum(found["result"] == getattr(Result, code))) for code in CODES}
            open_ = seen["beyond"] | seen["unjudged"]
            parts = (seen["wrong"], seen["ok"], open_)
            totals[name] = [a + int(part.sum()) for a, part in zip(totals[name], parts, strict=True)]
            kept = np.where(seen["ok"] & ~seen["beyond"] & ~seen["unjudged"], seen["margin"], 0.0)
            rows.append(
                [str(kind), name, *(f"{counts[code]}" for code in CODES), f"{seen['unjudged'].sum()}", f"{seen['beyond'].sum()}",
                 f"{np.nanmax(kept):.2g}", f"**{seen['wrong'].sum()}**"]
            )  # fmt: skip
            print(" | ".join(rows[-1]), f"{time.perf_counter() - began:.0f} s", flush=True)
            for k in np.flatnonzero(seen["wrong"])[: arguments.show]:
                numbers = ", ".join(f"{key}={value[k]:.6g}" for key, value in p.items())
                saw = {key: _shown(jax.tree.map(lambda x, k=k: x[k], x)) for key, x in found.items()}
                print(f"   silently wrong, scene {k}: {numbers}\n      {saw}")
    report.write(
        "random",
        "\n".join(
            [
                "## Random extreme scenes",
                "",
                f"`python benchmarks/random_extremes.py --scenes {arguments.scenes} --seed {arguments.seed}`: {each} scenes of "
                "each kind, each against half the step in float64; what is drawn and what counts as wrong is said in the "
                "script.  The largest error is over the promise, of scenes that end ok within their horizon.  Silently wrong in "
                "all: "
                + ", ".join(
                    f"{wrong} of {ok:,} that end ok in {name} ({open_:,} of these beyond their horizon or unjudged)"
                    for name, (wrong, ok, open_) in totals.items()
                )
                + ".",
                "",
                report.table(
                    ["scenes", "type", *CODES, "unjudged", "beyond horizon", "largest error", "silently wrong"], rows
                ),
            ]
        ),
        PAGE,
    )


if __name__ == "__main__":
    main()
