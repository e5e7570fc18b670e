"""Is a loaded or composite rod ever silently wrong?  Random scenes, each against other coordinates at a tight tolerance.

    python benchmarks/random_loads.py [--scenes 2000] [--seed 1]

Forces, laws, tables, steps, bodies at the tip, pivots, gravity vectors, starts at t0 up to 1.7e9 s, records and blows as
short as 1e-5 of the run.  A scene runs as `sweep` runs it by default.  The reference runs by Dopri8 in other coordinates
(where there are any) at a tolerance of 1e-11, and is given its blows as `Impulse`, whose edges it knows, whatever the scene
is given: a bare function, a `Record` or an `Impulse`.

A scene is *silently wrong* if it ends ok and its tip is off by more than 1e-8 of the largest distance from the pivot (at
least the length).  Where two references that start 1e-9 apart part so fast that runs 1e-12 apart would differ by more, it is
*beyond its horizon*, and counted apart.  Writes the part "loads" of docs/extremes.md.
"""

import argparse
import dataclasses
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jaxrod

jaxrod.configure()

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import random_extremes  # noqa: E402
import report  # noqa: E402

Partial: Any = jax.tree_util.Partial
PROMISE, TIGHT, APART, SHIFT = 1e-8, 1e-11, 1e-12, 1e-9
SAVED = 8
SAMPLES = 401  # of a record: read as smoothly as the blow is, to 1e-11
CODES = ("ok", "coarse", "max_steps", "unseen", "collapsed", "invalid")


class Kind(NamedTuple):
    """Scenes of one structure: what they are made of, from numbers `p` and the blow (a function of t); other coordinates."""

    name: str
    build: Callable[..., tuple[jaxrod.System, jaxrod.State]]
    forces: Callable
    form: str  # in which the blow is given
    chart: Any


def cone(p):
    return jaxrod.Rod(p["length"], jaxrod.Cone(0.02 * p["length"], 0.02 * p["ratio"] * p["length"]), p["young"], 1200.0)


def table(p):
    radii = 0.02 * p["length"] * jnp.stack([1.0 + 0 * p["ratio"], p["ratio"], 1.2 - 0.2 * p["ratio"], p["ratio"]])
    section = jaxrod.Table(p["length"] * np.array([0.0, 0.3, 0.55, 1.0]), radii)
    return jaxrod.Rod(p["length"], section, p["young"], 1200.0, tip_mass=p["body"], tip_inertia=1e-3 * p["body"])


def stepped(p):
    section = jaxrod.PiecewiseConstant([0.4], jnp.stack([1.0 + 0 * p["ratio"], p["ratio"]]) * 1e-3)
    young = jaxrod.PiecewiseConstant([0.7], p["young"] * jnp.stack([1.0 + 0 * p["ratio"], 1 + p["ratio"]]))
    return jaxrod.Rod(1.0, section, young, 1200.0, tip_mass=p["body"])


def rubber(p):
    return dataclasses.replace(cone(p), law=Partial(jaxrod.law.neo_hookean))


def _with(rod, motion, basis, **start):
    """A builder: `rod` and `motion` of p, forces of (p, blow, unit), where unit is a fair moment in N m."""

    def build(p, blow, forces):
        made = rod(p)
        gravity = p["gravity"] if start.get("vector") is None else p["gravity"] * start["vector"](p)
        bare = jaxrod.System(made, motion(p, blow), basis, gravity=gravity)
        rate = 2 * jnp.pi * jaxrod.natural_frequencies(jaxrod.System(made, bare.motion, jaxrod.LoadRitz(1)))[0]
        unit = made.moment_of_inertia() * rate**2
        system = dataclasses.replace(bare, forces=tuple(forces(p, blow, unit, made)))
        numbers = {} if isinstance(bare.motion, jaxrod.Driven) else {"angle": p["angle"], "rate": p["spin"] * rate}
        numbers |= {"strain": p["strain"]} if basis.n else {}
        numbers |= {"azimuth_rate": 0.5 * p["spin"] * rate} if isinstance(bare.motion, jaxrod.Spherical) else {}
        return system, system.state(**numbers)

    return build


class Scaled(NamedTuple):
    """A strength: a factor, or a vector, times the blow."""

    factor: Any
    blow: Any

    def __call__(self, t, state=None):
        return self.factor * self.blow(t)


class Sine(NamedTuple):
    """A sine of time, as a function (t, state) or of t."""

    factor: Any
    rate: Any
    since: Any

    def __call__(self, t, state=None):
        return self.factor * jnp.sin(self.rate * (t - self.since))


def held(function):
    """A function whose numbers are leaves; of functions that stay, so that the next scene is the same program."""
    return Partial(_called, function)


def _called(function, *at):
    return function(*at)


def _swaying(sine, t):
    return jnp.stack([sine(t), 0.5 * sine(t) ** 2])


def _spring(stiff, t, state):
    return -stiff * state.strain


def _drive(angle, t):
    return angle(t) + 0.1 * (t - angle.since)


def _bare(begin, width, t):
    inside = (t > begin) & (t < begin + width)
    return jnp.where(inside, 1 - jnp.cos(2 * jnp.pi * (t - begin) / width), 0.0)


def turned(p):
    return jnp.stack([jnp.sin(p["lean"]), -jnp.cos(p["lean"])])


def turned_3(p):
    return jnp.stack([0.6 * jnp.sin(p["lean"]), 0.8 * jnp.sin(p["lean"]), -jnp.cos(p["lean"])])


def at_root(p, blow):
    return jaxrod.Rotation()


def inside(p, blow):
    return jaxrod.Rotation(p["pivot"] * p["length"])


def in_space(p, blow):
    return jaxrod.Spherical()


def moment(p, blow, unit, rod):
    return [jaxrod.Torque(held(Scaled(0.05 * unit * p["push"], blow)))]


def moment_and_friction(p, blow, unit, rod):
    friction = 0.01 * jnp.sqrt(unit * rod.moment_of_inertia())
    return [*moment(p, blow, unit, rod), jaxrod.PivotFriction(friction), jaxrod.KelvinVoigt(1e-3 * p["unit"])]


def pull(p, blow, unit, rod):
    return [jaxrod.TipForce(held(Scaled(0.05 * unit * p["push"] / p["length"], blow)))]


def push_3(p, blow, unit, rod):
    aim = jnp.stack([0.6 + 0 * p["push"], 0.5 * p["push"], 0.3 + 0 * p["push"]])
    return [jaxrod.TipForce(held(Scaled(0.05 * unit / p["length"] * aim, blow)))]


def shaken(p, blow, unit, rod):
    way = 0.02 * p["length"] / p["unit"] ** 2 * jnp.stack([p["push"], 0.3 + 0 * p["push"]])
    return [jaxrod.ShakenBase(acceleration=held(Scaled(way, blow)))]


def swaying(p, blow, unit, rod):
    sine = Sine(0.02 * p["length"], p["pace"] / p["unit"], p["t0"])
    return [jaxrod.ShakenBase(Partial(_swaying, sine)), *moment(p, blow, unit, rod)]


def hum(p, blow, unit, rod):
    return [jaxrod.Torque(held(Sine(0.03 * unit * p["push"], p["pace"] / p["unit"], p["t0"])))]


def spring(p, blow, unit, rod):
    stiff = 0.1 * unit / p["length"]
    return [jaxrod.TipForce(Partial(_spring, stiff)), *moment(p, blow, unit, rod)]


def driven(p, blow):
    angle = Sine(0.7, 0.2 * p["pace"] / p["unit"], p["t0"])
    return jaxrod.Driven(Partial(_drive, angle))


NONE, ANGLES, DIRECTOR = None, jaxrod.Angles(), jaxrod.Director()
KINDS = [
    Kind("cone, bare blow", _with(cone, at_root, jaxrod.Ritz(1)), moment, "bare", ANGLES),
    Kind("rigid, record", _with(cone, at_root, jaxrod.Ritz(0)), moment, "record", DIRECTOR),
    Kind("table with a body, pivot inside, blow", _with(table, inside, jaxrod.Ritz(2)), moment, "impulse", ANGLES),
    Kind("steps, pull at the tip", _with(stepped, at_root, jaxrod.ForceRitz(2)), pull, "impulse", ANGLES),
    Kind(
        "space, leaning gravity, push at the tip",
        _with(cone, in_space, jaxrod.Ritz(1), vector=turned_3),
        push_3,
        "record",
        DIRECTOR,
    ),
    Kind("friction, viscosity, blow", _with(cone, at_root, jaxrod.Ritz(1)), moment_and_friction, "impulse", DIRECTOR),
    Kind(
        "friction, viscosity, bare blow", _with(table, at_root, jaxrod.Ritz(1)), moment_and_friction, "bare", DIRECTOR
    ),
    Kind(
        "neo-Hooke, leaning gravity, hum", _with(rubber, at_root, jaxrod.Ritz(1), vector=turned), hum, "impulse", ANGLES
    ),
    Kind("shaken by a record", _with(cone, inside, jaxrod.Ritz(1)), shaken, "record", ANGLES),
    Kind("swaying base, bare blow", _with(cone, at_root, jaxrod.Ritz(0)), swaying, "bare", DIRECTOR),
    Kind("spring at the tip, blow", _with(cone, at_root, jaxrod.Ritz(1)), spring, "impulse", ANGLES),
    Kind("driven, pull at the tip", _with(table, driven, jaxrod.Ritz(2)), pull, "record", NONE),
    Kind(
        "flight, pull at the tip",
        _with(cone, lambda p, blow: jaxrod.Flight(), jaxrod.Ritz(1)),
        pull,
        "impulse",
        DIRECTOR,
    ),
]


def draw(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """`count` scenes of a kind: the numbers that `scene` takes."""

    def decades(low, high):
        return 10.0 ** rng.uniform(low, high, count)

    length, young = decades(-1, 1), decades(6, 11)
    unit = length / np.sqrt(young / 1200.0)  # about one over the axial rate
    duration = unit * decades(0.5, 2.3)
    width = decades(-5, 0) * duration
    begin = rng.uniform(0.0, 1.0, count) * (duration - width) * 0.9
    return {
        "length": length, "young": young, "unit": unit, "duration": duration, "width": width, "begin": begin,
        "ratio": decades(-0.5, 0.5), "body": np.where(rng.random(count) < 0.5, 0.0, decades(-3, 1)),
        "pivot": rng.uniform(0.1, 0.9, count), "gravity": np.where(rng.random(count) < 0.2, 0.0, decades(-1, 1.5)),
        "lean": rng.uniform(-3, 3, count), "angle": rng.uniform(-np.pi, np.pi, count) * 0.45,
        "spin": rng.uniform(-0.3, 0.3, count), "strain": rng.uniform(-0.05, 0.05, count), "push": rng.uniform(-1, 1, count),
        "pace": decades(-1.5, 0.5), "t0": np.where(rng.random(count) < 0.5, 0.0, decades(0, 9.23)),
    }  # fmt: skip


def blow(form: str, p) -> Any:
    """A pulse (1 - cos) of height 2 in one of its forms."""
    begin = p["t0"] + p["begin"]
    if form == "impulse":
        return jaxrod.Impulse(p["width"], begin, p["width"])
    if form == "record":
        part = np.linspace(0.0, 1.0, SAMPLES)
        return jaxrod.Record(begin + p["width"] * part, np.append(1 - np.cos(2 * np.pi * part)[:-1], 0.0))
    return Partial(_bare, begin, p["width"])


def look(kind: Kind, p: dict) -> dict:
    """One scene: how it ended, its error, and how fast neighbours part."""
    ts = p["t0"] + p["duration"] * jnp.linspace(0.0, 1.0, SAVED + 1)[1:]
    system, start = kind.build(p, blow(kind.form, p), kind.forces)
    run = jaxrod.simulate(system, start, t0=p["t0"], ts=ts, max_steps=2**14)

    known, begun = kind.build(p, blow("impulse", p), kind.forces)
    solver = {"solver": diffrax.Dopri8(), "stepsize_controller": None} if kind.chart is None else {"chart": kind.chart}

    def reference(start):
        if kind.chart is None:  # the only coordinates; other steps, by default of the solver
            return jaxrod.simulate(known, start, t0=p["t0"], ts=ts, max_steps=2**16, **solver)
        return jaxrod.simulate(known, start, t0=p["t0"], ts=ts, tolerance=TIGHT, max_steps=2**16, **solver)

    right = reference(begun)
    beside = reference(
        dataclasses.replace(
            begun, direction_rate=begun.direction_rate * (1 + SHIFT), amplitudes=begun.amplitudes + SHIFT
        )
    )

    def place(sol):
        return jax.vmap(system.body.reach)(sol.states.amplitudes)[:, None] * sol.states.direction / system.rod.length

    size = jnp.maximum(jnp.max(jnp.linalg.norm(place(right), axis=-1)), 1.0)

    def apart(one, other):
        return jnp.max(jnp.linalg.norm(place(one) - place(other), axis=-1)) / size

    return {
        "result": run.result,
        "right": right.result,
        "error": apart(run, right),
        "growth": apart(beside, right) / SHIFT,
        "steps": run.stats["num_steps"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--scenes", type=int, default=2000, help="how many, over all kinds (default 2000)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    parser.add_argument("--kinds", default="", help="only those whose name holds this")
    parser.add_argument("--show", type=int, default=3, help="offenders to print of each kind (default 3)")
    arguments = parser.parse_args()
    rng, began, rows, totals = np.random.default_rng(arguments.seed), time.perf_counter(), [], np.zeros(3, int)
    each = -(-arguments.scenes // len(KINDS))
    for kind in KINDS:
        p = draw(each, rng)
        if arguments.kinds not in kind.name:
            continue
        with report.quiet():
            found = jaxrod.sweep(lambda p, k=kind: look(k, p), p, order_by=p["duration"] / p["unit"], progress=False)
        jax.clear_caches()
        found = {name: np.asarray(x) for name, x in found.items()}
        ok, judged = found["result"] == jaxrod.Result.ok, found["right"] == jaxrod.Result.ok
        # A stamp of 1e9 s has 2e-7 s of rounding, which the edges of a blow given on that clock have too, and each sample: half
        # of it by the steepest slope of the pulse, 2 pi over its width.
        rounding = np.pi * np.spacing(p["t0"]) / p["width"]
        promise = PROMISE + np.where(p["t0"] > 0, rounding, 0.0)
        beyond = ~(found["growth"] * APART <= promise)
        wrong = ok & judged & ~beyond & ~(found["error"] <= promise)
        totals += [wrong.sum(), ok.sum(), (ok & (beyond | ~judged)).sum()]
        counts = [str((found["result"] == getattr(jaxrod.Result, code)).sum()) for code in CODES]
        kept = found["error"][ok & judged & ~beyond] / promise[ok & judged & ~beyond]
        rows.append(
            [kind.name, *counts, f"{(ok & ~judged).sum()}", f"{(ok & judged & beyond).sum()}",
             f"{np.max(kept, initial=0.0):.2g}", f"**{wrong.sum()}**"]
        )  # fmt: skip
        print(" | ".join(rows[-1]), f"{time.perf_counter() - began:.0f} s", flush=True)
        for k in np.flatnonzero(wrong)[: arguments.show]:
            numbers = ", ".join(f"{key}={value[k]:.6g}" for key, value in p.items())
            print(f"   silently wrong, scene {k}: {numbers}\n      { {key: value[k] for key, value in found.items()} }")
    wrong, ok, open_ = totals
    text = (
        "## Random loads\n\n"
        f"`python benchmarks/random_loads.py --scenes {arguments.scenes} --seed {arguments.seed}`: {each} scenes of each kind, "
        "each against other coordinates at a tolerance of 1e-11; what is drawn and what counts as wrong is said in the script.  "
        f"The largest error is over the promise.  Silently wrong in all: {wrong} of {ok:,} that end ok ({open_:,} of these "
        "beyond their horizon or without a reference).\n\n"
    )
    head = ["scenes", *CODES, "no reference", "beyond horizon", "largest error", "silently wrong"]
    if not arguments.kinds:
        report.write("loads", text + report.table(head, rows), random_extremes.PAGE)


if __name__ == "__main__":
    main()
