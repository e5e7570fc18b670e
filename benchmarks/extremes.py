"""The ends of the scale: what becomes of a run there, against a yardstick, float64 and float32.

    python benchmarks/extremes.py

Each row is a run with the library's defaults (or the steps it says), its verdict computed from the numbers beside it:

- *holds*: it ended ok, off its yardstick by no more than the promise of `tolerance` (1e-8; float32 1e-4, and 6e-7 for each
  radian turned; of longer runs than 1,000 axial periods in proportion), and what physics keeps was kept to ten times that;
- *says so*: it did not end ok, and its result code or a refusal before the run says why;
- *beyond its horizon*: it ended ok and is further off, but so are two starts that rounding sets apart (`jaxrod.horizon`);
- *no yardstick*: it ended ok, and no finer run reaches its end;
- *phase lost*: so long a run in that type promises nothing of its place (more than half of its distance), and what physics
  keeps is kept;
- **WRONG**: none of these.

Runs of given steps promise no more than to be stable: a tenth.

Writes the part "extremes" of docs/extremes.md.
"""

import argparse
import dataclasses
from collections.abc import Callable, Iterator
from types import MappingProxyType
from typing import Any, NamedTuple

import jaxrod

jaxrod.configure()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402
from random_extremes import EACH_RADIAN, PAGE, PROMISE  # noqa: E402

from jaxrod import Result  # noqa: E402

GRAVITY = 9.81
LOST = 0.5  # of the distance from the pivot: a promise beyond it says nothing of a place
APART = {"float64": 1e-12, "float32": 6e-8}


class Run(NamedTuple):
    """One scene: its name, what is run, for how many axial periods, and its yardstick.

    `exact`: from a finished solution to its error by a closed form; None for half the step in float64.  `saves`: how many
    times are saved, each the end of a step.
    """

    name: str
    system: jaxrod.System
    start: Any
    periods: float
    options: Any = MappingProxyType({})
    exact: Callable[[Any], float] | None = None
    note: Callable[[Any], str] | None = None
    saves: int = 41


class Extreme(NamedTuple):
    """A kind of extreme: its title, why it comes out as it does, and its runs."""

    title: str
    why: str
    runs: Callable[[], Iterator[Run]]


def system_of(motion=None, n=1, gravity: Any = GRAVITY, *, young=1e7, length=1.0, root=0.02, tip=0.03, tip_mass=0.0):
    """The rod of Figure 2 but for what is said; of one structure, so that its runs share a program."""
    rod = jaxrod.Rod(length, jaxrod.Cone(root * length, tip * length), young, 1200.0)
    rod = dataclasses.replace(rod, tip_mass=jnp.asarray(tip_mass * rod.mass))
    return jaxrod.System(rod, motion or jaxrod.Rotation(), jaxrod.Ritz(n), gravity)


def axial_rate(system) -> float:
    """In rad/s: the scene's own, of a rigid rod that of one shape."""
    own = system if system.basis.n else dataclasses.replace(system, basis=jaxrod.Ritz(1))
    return 2 * np.pi * float(jaxrod.natural_frequencies(own)[0])


def swinging(system, spin=0.2, **numbers):
    """A start that swings and vibrates: a fifth of the axial rate, a strain of a hundredth."""
    return system.state(**{"angle": -1.0, "rate": spin * axial_rate(system), "strain": 0.01, **numbers})


# ---- the extremes


def stiffness():
    for young in (1e3, 1e6, 1e9, 1e12, 1e15):
        system = system_of(young=young)
        yield Run(f"E = {young:.0e} Pa", system, swinging(system), 20)


def weight():
    for ratio in (1e-3, 1.0, 1e3, 1e6, 1e9, 1e12):
        system = system_of(gravity=1e7 / (1200.0 * ratio))
        yield Run(f"E / (rho g L) = {ratio:.0e}", system, system.state(angle=-1.0), 20)


def free_spin():
    for n in (1, 3):
        for times in (0.5, 1.0, 3.0):
            system = system_of(gravity=None, n=n)
            critical = float(jaxrod.continuum.critical_rate(system))
            yield Run(f"{times:g} x critical, Ritz({n})", system, system.state(rate=times * critical), 20)


def driven_spin():
    for n in (1, 3):
        for times in (0.5, 0.99, 1.01, 3.0):
            plain = system_of(gravity=None, n=n)
            omega = axial_rate(plain)
            spin = times * omega
            system = dataclasses.replace(plain, motion=jaxrod.scenes.steady(jnp.asarray(spin)))
            name = f"{times:g} x its own critical rate, Ritz({n})"
            if n > 1:
                yield Run(name, system, system.state(), 5, saves=200, note=lambda sol, w=spin: growth_note(sol, w))
                continue

            def exact(sol, omega=omega, spin=spin):
                square = spin**2 - omega**2
                t, rate = np.asarray(sol.ts, float), np.sqrt(abs(square))
                grown = np.cosh(rate * t) if square > 0 else np.cos(rate * t)
                want = spin**2 / square * (grown - 1)
                return float(np.max(np.abs(np.asarray(sol.strain, float) - want)) / np.max(np.abs(1 + want)))

            yield Run(name, system, system.state(), 5, exact=exact, note=lambda sol, w=spin: growth_note(sol, w))


def growth_note(sol, spin) -> str:
    """The rate at which the lowest mode grew, beside the root of W^2 - omega_1^2."""
    omega = axial_rate(sol.system)
    if spin <= omega:
        return "bounded"
    amplitudes, body = np.asarray(sol.states.amplitudes, float), sol.system.body
    amplitudes = amplitudes[np.isfinite(amplitudes).all(axis=1)]
    half = np.linalg.cholesky(np.asarray(body.strain_mass, float))
    inverse = np.linalg.inv(half)
    shapes = np.linalg.eigh(inverse @ np.asarray(body.stiffness_matrix, float) @ inverse.T)[1]
    lowest = np.concatenate([[0.0], amplitudes @ half @ shapes[:, 0]])
    if lowest.size < 4:
        return ""
    # From rest it is a multiple of cosh(r t) - 1 = 2 sinh(r t / 2)^2, and sinh(x + h) + sinh(x - h) = 2 cosh(h) sinh(x).
    root = np.sqrt(np.abs(lowest))
    ratio = root[1:-1] @ (root[2:] + root[:-2]) / (2 * root[1:-1] @ root[1:-1])
    found = 2 * np.arccosh(ratio) / float(sol.ts[1] - sol.ts[0])
    return f"grows at {found:.5g} /s; root of W^2 - omega_1^2: {np.sqrt(spin**2 - omega**2):.5g} /s"


def collapse():
    system = system_of(gravity=None)
    omega = axial_rate(system)
    for times in (0.9, 3.0, 100.0):
        start = system.state(angle=0.7, strain_rate=-times * omega)

        def exact(sol, times=times):
            t, strain = np.asarray(sol.ts, float), np.asarray(sol.strain, float)
            return float(np.nanmax(np.abs(strain + times * np.sin(omega * t)), initial=0.0))

        yield Run(f"thrown inwards at {times:g} of the axial rate", system, start, 1.9, exact=exact)
    for spin in (1e-1, 1e-2, 1e-3, 1e-6):
        start = system.state(rate=spin * omega, strain_rate=-1.5 * omega)
        yield Run(f"the same at 1.5, turning at {spin:g} of it", system, start, 1.9)


def poles():
    plane = jaxrod.Spherical()
    for n in (0, 1, 3):
        for name, numbers in (
            ("from the pole", {"angle": np.pi / 2, "rate": 15.0}),
            ("1e-8 rad beside it", {"angle": np.pi / 2 - 1e-8, "rate": 15.0, "azimuth_rate": 3.0}),
            ("over the top", {"angle": 1.2, "rate": 15.0}),
        ):
            system = system_of(plane, n=n)
            yield Run(f"{name}, Ritz({n})", system, system.state(**numbers), 40)


def upright():
    system = system_of()
    rod: Any = system.rod
    inertia, moment, stiffness_ = float(rod.moment_of_inertia()), float(rod.first_moment()), float(rod.stiffness)
    sag = GRAVITY * moment / stiffness_
    growth = np.sqrt(GRAVITY * moment / inertia / (1 - sag))
    for lean in (0.0, 1e-6):

        def exact(sol, lean=lean):
            sin = np.asarray(sol.director, float)[:, 0]
            return float(np.max(np.abs(sin - lean * np.cosh(growth * np.asarray(sol.ts, float)))))

        start = system.state(angle=np.pi / 2 - lean, strain=-sag)
        yield Run(f"upright, leaning by {lean:g}", system, start, 10, exact=exact)


def no_gravity():
    for gravity in (None, 0.0):
        for motion in (jaxrod.Rotation(), jaxrod.Spherical(), jaxrod.Flight()):
            system = system_of(motion, gravity=gravity)
            yield Run(f"gravity={gravity}, {type(motion).__name__}", system, swinging(system), 20)


def tapers():
    # A force would stretch a pointed tip without bound: no shape has one there.
    force, load = jaxrod.ForceRitz(3), jaxrod.LoadRitz(3)
    for root, tip, several in ((0.03, 3e-5, force), (3e-5, 0.03, force), (0.03, 0.0, load)):
        for n, basis in ((1, jaxrod.Ritz(1)), (3, several)):
            system = dataclasses.replace(system_of(root=root, tip=tip), basis=basis)
            exact = float(jaxrod.continuum.natural_frequencies(system, 1)[0])
            off = float(jaxrod.natural_frequencies(system)[0]) / exact - 1
            note = f"first frequency {off:+.1e} of the exact rod's"
            name = f"radii {root:g} to {tip:g} m, {type(basis).__name__}({n})"
            yield Run(name, system, swinging(system), 20, note=lambda sol, note=note: note)
    system = system_of(jaxrod.Flight(), root=0.0, tip=0.03)
    yield Run("flight, radii 0 to 0.03 m, Ritz(1)", system, swinging(system), 20)


def tip_masses():
    for mass in (1e-3, 1.0, 1e3, 1e6):
        system = system_of(tip_mass=mass)
        yield Run(f"{mass:g} rod masses", system, swinging(system), 20)


def lengths():
    for length in (1e-9, 1e-6, 1e-3, 1e3, 1e6):
        for n in (1, 3):
            system = system_of(length=length, n=n)
            yield Run(f"L = {length:g} m, Ritz({n})", system, swinging(system), 20)


def long_runs(periods):
    system = system_of()
    yield Run(f"{periods:g} axial periods", system, system.state(rate=15.0), periods, {"max_steps": 2**30})


def long_steps():
    system = system_of()
    omega = axial_rate(system)
    periods = 40
    fewest = periods * 2 * np.pi / jaxrod.BlanesMoan6().stable_phase
    for times in (0.01, 0.1, 0.5, 0.9, 1.1, 2.0, 8.0):
        steps = max(1, round(fewest * times))
        run = Run(f"{steps} steps ({times:g} of stability's)", system, system.state(rate=15.0), periods, saves=1)
        yield run._replace(options={"n_steps": steps})
    driven = dataclasses.replace(system, motion=jaxrod.scenes.steady(jnp.asarray(0.3 * omega)))
    for steps in (10, 40, 80, 800):
        run = Run(f"driven at 0.3 of the axial rate, {steps} steps", driven, driven.state(), periods, saves=1)
        yield run._replace(options={"n_steps": steps})


# ---- what is made of a run


def measured(run: Run, dtype: str) -> list[str]:
    """A row of the table."""
    floats = jnp.dtype(dtype)
    rounded = jax.tree.map(lambda x: x.astype(floats), (run.system, run.start))
    end = float(np.float32(run.periods * 2 * np.pi / axial_rate(run.system)))
    ts = jnp.asarray(np.float32(np.linspace(0, 1, run.saves + 1)[1:] * end), floats)
    try:
        sol = jaxrod.simulate(*rounded, ts=ts, throw=False, **run.options)
    except ValueError as refused:
        return [run.name, dtype, "refused", "", "", "", "", "says so", str(refused).split(";")[0]]
    ok, book = bool(sol.ok), sol.ledger
    turned = (
        float(np.nanmean(np.linalg.norm(np.asarray(sol.states.direction_rate, float), axis=-1))) * end if ok else 0.0
    )
    promise = (PROMISE[dtype] + EACH_RADIAN[dtype] * turned) * max(1.0, run.periods / 1000)
    if "n_steps" in run.options:
        promise = 0.1
    off = run.exact(sol) if run.exact is not None else against_half(run, sol) if ok else np.nan
    kept = [float(x) for x in (book.energy, book.angular_momentum) if x is not None]
    judged = "says so"
    if ok:
        holds = off <= promise and max(kept, default=0.0) <= 10 * promise
        judged = "holds" if holds else "no yardstick" if np.isnan(off) else "**WRONG**"
        if promise > LOST and max(kept, default=0.0) <= 10 * LOST:
            judged = "phase lost"
        if judged == "**WRONG**" and beyond(rounded, end, promise, dtype):
            judged = "beyond its horizon"
    note = run.note(sol) if run.note is not None else ""
    if not ok:
        note = f"at t = {float(sol.stats['t_end']):.3g} s" + ("; " + note if note else "")
    return [
        run.name, dtype, code(sol.result), f"{off:.1e}", f"{promise:.0e}", ", ".join(f"{x:.0e}" for x in kept) or "–",
        f"{float(book.room):.3g}", judged, note,
    ]  # fmt: skip


def code(result) -> str:
    return next(name for name in ("ok", "collapsed", "diverged", "max_steps", "coarse", "non_finite", "past_critical", "invalid")
                if bool(result == getattr(Result, name)))  # fmt: skip


def against_half(run: Run, sol) -> float:
    """Largest distance of the tip from that of a run in float64 of half the step, over the largest from the pivot."""
    system, start = jax.tree.map(lambda x: x.astype(sol.ts.dtype).astype(jnp.float64), (run.system, run.start))
    options: Any = {"max_steps": 2**24} | {key: value for key, value in run.options.items() if key != "n_steps"}
    ts = sol.ts.astype(jnp.float64)
    if sol.ts.dtype == jnp.float64 and "adaptive" not in sol.stats["why"]:
        finer = jaxrod.simulate(system, start, ts=ts, n_steps=2 * int(sol.stats["num_steps"]), throw=False, **options)
    else:
        finer = jaxrod.simulate(system, start, ts=ts, tolerance=1e-10, throw=False, **options)
    right, found = np.asarray(place(finer)), np.asarray(place(sol), float)
    return float(np.max(np.linalg.norm(found - right, axis=-1)) / np.max(np.linalg.norm(right, axis=-1)))


def place(sol):
    """Of the tip from the pivot, in flight from the centre of mass."""
    return sol.tip if sol.center is None else sol.tip - sol.center


def beyond(scene, end, promise, dtype) -> bool:
    system, start = jax.tree.map(lambda x: x.astype(jnp.float64), scene)
    return float(jaxrod.horizon(system, start, t1=end, tolerance=promise, distance=APART[dtype]).time) < end


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--periods", type=float, default=1e6, help="axial periods of the long run (default 10^6)")
    parser.add_argument("--only", default="", help="those extremes alone whose title holds this; writes nothing")
    arguments = parser.parse_args()
    extremes = [
        Extreme(
            "Stiffness",
            "Steps are counted in axial periods, so the modulus costs no accuracy.",
            stiffness,
        ),
        Extreme(
            "Stiffness over weight",
            "A soft rod falls far: its kicks, gravity, are as large as its springs. At 1e-3 it falls hundreds of "
            "lengths, of which float32 keeps too few digits for its steps.",
            weight,
        ),
        Extreme(
            "Free spin",
            "Angular momentum is kept: stretching slows the rod, and no rate is critical. Set to 3 times critical "
            "at once, it is stretched to several lengths; three shapes see a section pressed through itself on "
            "the way back, one shape has none.",
            free_spin,
        ),
        Extreme(
            "Driven spin",
            "Beyond the critical rate the lowest mode grows at the root of W^2 - omega_1^2, until a section is pressed "
            "through itself (several shapes) or it passes all bounds.",
            driven_spin,
        ),
        Extreme(
            "Collapse",
            "Without angular momentum the rod reaches nothing; with some it turns ever faster, and below a strain "
            "of -2/3 steps are not trusted. The closest passes need more steps than a run may take, or than a "
            "finer one has.",
            collapse,
        ),
        Extreme(
            "Poles",
            "Director and q = (1 + eps) d have no pole.",
            poles,
        ),
        Extreme(
            "Standing upright",
            "A lean grows as cosh; pi/2 is no floating-point number.",
            upright,
        ),
        Extreme(
            "No gravity",
            "None leaves the term out, 0.0 multiplies it by zero.",
            no_gravity,
        ),
        Extreme(
            "Tapers",
            "The run is as right as elsewhere; uniform strain is the wrong shape. Force shapes put the strain "
            "where the rod is thin: at a point, or nearly, a start stretched by a hundredth is pressed through "
            "itself at once.",
            tapers,
        ),
        Extreme(
            "Bodies at the tip",
            "They lower the axial rate, and the steps follow it.",
            tip_masses,
        ),
        Extreme(
            "Lengths",
            "Flows are per moment of inertia; float32 ends at 1e-38. At 1e6 m this rubber weighs a thousand times "
            "its stiffness: it falls to many lengths and is pressed through itself.",
            lengths,
        ),
        Extreme(
            "Long runs",
            "Errors of phase grow in proportion to time, the energy has no trend. Of so many periods in float32 "
            "runs of fewer steps disagree: they are not believed, nor are steps that adapt.",
            lambda: long_runs(arguments.periods),
        ),
        Extreme(
            "Long steps",
            "A step beyond stability is named first; the exact oscillators of float32 have none.",
            long_steps,
        ),
    ]
    head = ["scene", "type", "result", "error", "promise", "energy, momentum", "room", "verdict", "note"]
    parts, count = ["## The ends of the scale", "", _preamble()], {}
    for extreme in extremes:
        if arguments.only not in extreme.title:
            continue
        with report.quiet():
            rows = [measured(run, dtype) for run in extreme.runs() for dtype in ("float64", "float32")]
        for row in rows:
            count[row[7]] = count.get(row[7], 0) + 1
        parts += ["", f"### {extreme.title}", "", extreme.why, "", report.table(head, rows)]
        print("\n".join(parts[-4:]), flush=True)
    parts.insert(3, "\n" + ", ".join(f"{name}: {n}" for name, n in count.items()) + ".")
    if not arguments.only:
        report.write("extremes", "\n".join(parts), PAGE)


def _preamble() -> str:
    return (__doc__ or "").split("\n\n", 2)[2].rsplit("\n\n", 1)[0]


if __name__ == "__main__":
    main()
