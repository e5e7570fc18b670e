"""How many shapes does a rod need?  Errors of the first three natural frequencies in each basis, n = 1 .. 12.

    python benchmarks/convergence.py [--out docs]

The reference is `jaxrod.continuum`, itself first compared with closed forms, solved here by bracketing.  Then the
steady stretch of a spinning rod.  Writes accuracy.md and convergence.png to the folder.
"""

import argparse
import dataclasses
import functools
import pathlib
from typing import Any, NamedTuple

import jaxrod

jaxrod.configure()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import report  # noqa: E402
import scipy.optimize  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

BASES = (jaxrod.Ritz, jaxrod.ForceRitz, jaxrod.LoadRitz)
COLORS = ("#1f5fa8", "#d9661f", "#2a7f3f")
N = 12
KEPT = 3  # frequencies
SHOWN = (1, 2, 4, 8)
WANTED, BY = 1e-6, 8
FLOOR = 1e-13  # below it rounding is what is left
SPINS, SPIN_SHAPES = (0.1, 0.3, 0.5, 0.7, 0.9), (1, 2, 3, 4)
MEASURED = pathlib.Path(__file__).parent.parent / "notebooks" / "measured_radii.csv"
LENGTH, YOUNG, DENSITY = 1.0, 1e7, 1200.0


class Case(NamedTuple):
    """A scene whose basis is still to choose, and omega length / sqrt(E / rho) in closed form where there is one."""

    name: str
    system: jaxrod.System
    kappa: np.ndarray | None


def zeros(equation, starts, ends):
    return np.array([scipy.optimize.brentq(equation, a, b, xtol=1e-16) for a, b in zip(starts, ends, strict=True)])


def cone_kappa(held, free):
    """kappa cot kappa = 1 - held / free: one root in each interval of pi."""
    c = 1 - held / free
    k = np.arange(KEPT) * np.pi
    return zeros(lambda x: x * np.cos(x) - c * np.sin(x), np.maximum(k, 1e-6), k + np.pi)


def cases():
    def case(name, section, kappa, motion=None, **numbers):
        given: dict[str, Any] = {"length": LENGTH, "young": YOUNG, "density": DENSITY, **numbers}
        rod = jaxrod.Rod(section=section, **given)
        return Case(name, jaxrod.System(rod, motion or jaxrod.Rotation()), kappa)

    odd = (np.arange(KEPT) + 0.5) * np.pi
    yield case("uniform", jaxrod.Cone(0.025, 0.025), odd)  # a cone too, so as not to compile once more
    for tip, root in ((1, 1000), (1, 100), (1, 10), (2, 3), (3, 2), (10, 1), (100, 1), (1000, 1)):
        r, R = (0.03 * x / max(tip, root) for x in (root, tip))
        yield case(f"cone {tip} : {root}", jaxrod.Cone(r, R), cone_kappa(r, R))
    for name, root, tip in (("root", 4e-3, 1e-3), ("tip", 1e-3, 4e-3)):
        # tan^2(kappa / 2) = A_root / A_tip
        x = np.arctan(np.sqrt(root / tip))
        yield case(
            f"step with a thick {name}",
            jaxrod.PiecewiseConstant([0.5], [root, tip]),
            2 * np.array([x, np.pi - x, np.pi + x]),
        )
    parts = [cone_kappa(0.023, 0.02) / 0.3, cone_kappa(0.023, 0.03) / 0.7]
    kappa = np.sort(np.concatenate(parts))[:KEPT]
    yield case("the paper's cone pivoted at 0.3", jaxrod.Cone(0.02, 0.03), kappa, jaxrod.Rotation(0.3))
    kappa = np.sort(np.concatenate([odd / 0.5, odd / 0.5]))[:KEPT]
    yield case("uniform pivoted in the middle", jaxrod.Cone(0.025, 0.025), kappa, jaxrod.Rotation(0.5))
    mass = float(jaxrod.Rod(LENGTH, jaxrod.Uniform(0.025), YOUNG, DENSITY).mass)
    k = np.arange(KEPT) * np.pi
    kappa = zeros(lambda x: x * np.sin(x) - np.cos(x), k, k + np.pi / 2)  # kappa tan kappa = 1
    yield case("uniform with its mass again at the tip", jaxrod.Uniform(0.025), kappa, tip_mass=mass)
    station, radius = 1e-3 * np.loadtxt(MEASURED, delimiter=",", skiprows=1).T
    yield case("measured radii", jaxrod.Table(station, radius), None, length=station[-1])


def exact_frequencies(system: jaxrod.System) -> np.ndarray:
    return np.asarray(jaxrod.continuum.natural_frequencies(system, KEPT))


# Compiled in haste, five times faster: each program runs for milliseconds.
HASTE = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}
frequencies = jax.jit(jaxrod.natural_frequencies, compiler_options=HASTE)


def measure(scenes: list[Case], exact: np.ndarray) -> np.ndarray:
    """Relative errors (case, basis, n - 1, frequency); NaN where n shapes have no such frequency."""
    errors = np.full((len(scenes), len(BASES), N, KEPT), np.nan)
    for b, basis in enumerate(BASES):
        for n in range(1, N + 1):
            for c, scene in enumerate(scenes):
                found = np.asarray(frequencies(dataclasses.replace(scene.system, basis=basis(n))))[:KEPT]
                errors[c, b, n - 1, : found.size] = np.abs(found / exact[c, : found.size] - 1)
    return errors


def shapes_needed(errors: np.ndarray) -> np.ndarray:
    """The smallest n with an error of at most WANTED; N + 1 where there is none.  errors (..., N, KEPT)."""
    reached = errors <= WANTED  # of NaN false
    return np.where(reached.any(axis=-2), reached.argmax(axis=-2) + 1, N + 1)


def decades_per_shape(errors: np.ndarray) -> float:
    """Least squares of log10(error) against n, above FLOOR and the first below it.  errors (N,)."""
    n = np.arange(1, N + 1)
    rounded = np.concatenate([[0], np.cumsum(errors <= FLOOR)[:-1]])  # how many before this one were below
    kept = np.isfinite(errors) & (rounded == 0)
    return float(-np.polyfit(n[kept], np.log10(np.maximum(errors[kept], 1e-16)), 1)[0])


# ---- the page


def number(n: int) -> str:
    return f"> {N}" if n > N else str(n)


def percent(x: float) -> str:
    return f"{100 * x:.1e} %" if x < 1e-4 else f"{100 * x:.2g} %" if x < 0.1 else f"{100 * x:.0f} %"


def listed(names: list[str]) -> str:
    return ", ".join(names) if names else "none"


def closed_forms(scenes: list[Case], exact: np.ndarray) -> str:
    lines = [
        "| case | f1, f2, f3 of `continuum`, Hz | largest difference from the closed form |",
        "| --- | --- | ---: |",
    ]
    for scene, f in zip(scenes, exact, strict=True):
        off = "no closed form"
        if scene.kappa is not None:
            assert isinstance(scene.system.rod, jaxrod.Rod)
            closed = scene.kappa / (2 * np.pi) * float(scene.system.rod.wave_speed / scene.system.rod.length)
            off = f"{np.max(np.abs(f / closed - 1)):.0e}"
        lines.append(f"| {scene.name} | {', '.join(f'{x:.6f}' for x in f)} | {off} |")
    return "\n".join(lines)


def table(scenes: list[Case], errors: np.ndarray) -> str:
    needed = shapes_needed(errors)
    lines = [
        f"| case | basis | {' | '.join(f'n = {n}' for n in SHOWN)} | n for {WANTED:.0e} | decades per shape |",
        "| --- | --- |" + " --- |" * len(SHOWN) + " --- | --- |",
    ]
    for c, scene in enumerate(scenes):
        for b, basis in enumerate(BASES):
            cells = [scene.name if b == 0 else "", basis.__name__]
            cells += [", ".join("–" if np.isnan(x) else f"{x:.0e}" for x in errors[c, b, n - 1]) for n in SHOWN]
            cells.append(", ".join(number(n) for n in needed[c, b]))
            cells.append(", ".join(f"{decades_per_shape(errors[c, b, :, k]):.1f}" for k in range(KEPT)))
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def choice(scenes: list[Case], errors: np.ndarray) -> str:
    """What to take, in sentences whose numbers and names come from the data."""
    needed, names = shapes_needed(errors), [scene.name for scene in scenes]
    total, alone = needed.sum(axis=-1), errors[:, :, 0, 0]
    out = [f"**Which basis.** Shapes that bring f1, f2 and f3 to {WANTED:.0e}, summed (not within {N}: {N + 1}):", ""]
    for b, basis in enumerate(BASES):
        rest = np.delete(total, b, axis=1).min(axis=1)
        fewest = [f"{name} ({x} against {y})" for name, x, y in zip(names, total[:, b], rest, strict=True) if x < y]
        out.append(f"- `{basis.__name__}` needs the fewest: {listed(fewest)}.")
    for b, basis in enumerate(BASES):
        missed = [
            f"{name} (off by {percent(errors[c, b, -1, 0])})" for c, name in enumerate(names) if needed[c, b, 0] > N
        ]
        out.append(f"- `{basis.__name__}({N})` does not bring f1 to {WANTED:.0e}: {listed(missed)}.")
    out += ["", "**One shape.** Error of f1:", ""]
    for b, basis in enumerate(BASES):
        rest = np.delete(alone, b, axis=1).min(axis=1)
        nearer = [
            f"{name} ({percent(x)} against {percent(y)})"
            for name, x, y in zip(names, alone[:, b], rest, strict=True)
            if x < 0.999 * y
        ]
        out.append(f"- `{basis.__name__}(1)` is the nearest: {listed(nearer)}.")
    best = needed.min(axis=1)
    out += ["", f"**{WANTED:.0e} with n <= {BY}**, each frequency in its best basis:", ""]
    for k in range(KEPT):
        late = [
            f"n {'' if n > N else '= '}{number(n)} for {listed([x for x, m in zip(names, best[:, k], strict=True) if m == n])}"
            for n in sorted(set(best[best[:, k] > BY, k]))
        ]
        holds = int((best[:, k] <= BY).sum())
        out.append(f"- f{k + 1}: {holds} of {len(names)} cases. More: {'; '.join(late) if late else 'none'}.")
    rates = [max(decades_per_shape(errors[c, b, :, 0]) for b in range(len(BASES))) for c in range(len(names))]
    low, high = int(np.argmin(rates)), int(np.argmax(rates))
    out += [
        "",
        f"In the best basis a shape adds {rates[low]:.1f} ({names[low]}) to {rates[high]:.1f} ({names[high]}) decades "
        f"to f1, {np.median(rates):.1f} in the median case.",
    ]
    return "\n".join(out)


def picture(scenes: list[Case], errors: np.ndarray) -> Figure:
    columns = 5
    figure = Figure(figsize=(12.0, 2.4 * -(-len(scenes) // columns)), layout="constrained")
    axes = figure.subplots(-(-len(scenes) // columns), columns, sharex=True, sharey=True, squeeze=False)
    n = np.arange(1, N + 1)
    for axis in axes.flat[len(scenes) :]:
        axis.set_visible(False)
    for axis, scene, of_case in zip(axes.flat, scenes, errors, strict=False):
        for basis, color, mark, of_basis in zip(BASES, COLORS, "os^", of_case, strict=True):
            shown = np.maximum(of_basis, 1e-16)
            axis.semilogy(n, shown[:, 1:], "-", color=color, alpha=0.35, linewidth=0.9)
            size = 5.5 if mark == "o" else 3.0  # both are seen where they coincide
            axis.semilogy(n, shown[:, 0], f"-{mark}", color=color, markersize=size, linewidth=1.3, label=basis.__name__)
        axis.axhline(WANTED, color="black", linewidth=0.7, linestyle=":")
        axis.set_title(scene.name, fontsize=9)
        axis.grid(alpha=0.25)
        axis.set_xticks(range(2, N + 1, 2))
        axis.set_ylim(1e-16, 1e2)
        axis.set_yticks([1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1e0])
    for axis in axes[-1]:
        axis.set_xlabel("shapes n", fontsize=9)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error", fontsize=9)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(BASES), fontsize=9)
    return figure


@functools.partial(jax.jit, compiler_options=HASTE)
def stretch(system: jaxrod.System, rate: jax.Array) -> jax.Array:
    """Of the tip in m, in a steady spin in rad/s."""
    return jnp.linalg.norm(system.tip(jaxrod.equilibrium(system, spin=rate))) - system.rod.length


def spin() -> str:
    """Error of the tip's steady stretch, without gravity, against the exact rod."""
    lines = [
        f"| rod | basis | n | {' | '.join(f'{part:g} of critical' for part in SPINS)} |",
        "| --- | --- | ---: |" + " ---: |" * len(SPINS),
    ]
    for name, section in (("uniform", jaxrod.Cone(0.025, 0.025)), ("the paper's cone", jaxrod.Cone(0.02, 0.03))):
        bare = jaxrod.System(jaxrod.Rod(LENGTH, section, YOUNG, DENSITY), jaxrod.Rotation())
        rates = jnp.array(SPINS) * jaxrod.continuum.critical_rate(bare)
        exact = np.array([jaxrod.continuum.steady_spin(bare, rate) for rate in rates])
        lines.append(f"| {name} | exact stretch, mm | | {' | '.join(f'{1e3 * x:.3g}' for x in exact)} |")
        for basis in BASES:
            for n in SPIN_SHAPES:
                system = dataclasses.replace(bare, basis=basis(n))
                off = np.array([stretch(system, rate) for rate in rates]) / exact - 1
                lines.append(f"| | {basis.__name__} | {n} | {' | '.join(f'{x:+.0e}' for x in off)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Convergence of the bases to the exact rod.")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("docs"), help="folder to write (default docs)")
    arguments = parser.parse_args()
    scenes = list(cases())
    exact = np.array([exact_frequencies(scene.system) for scene in scenes])
    errors = measure(scenes, exact)
    text = "\n\n".join(
        [
            "## How many shapes does a rod need?",
            "`python benchmarks/convergence.py`: `jaxrod.natural_frequencies` of a basis with n shapes against "
            "`jaxrod.continuum.natural_frequencies`, the rod held at its root by `Rotation()` unless said. "
            f"{LENGTH:g} m, {YOUNG:g} Pa, {DENSITY:g} kg/m³; cones by tip : root radius, steps 4 : 1 in area in the middle, "
            "the measured radii from `notebooks/measured_radii.csv`.",
            "![Errors against the number of shapes](convergence.png)",
            "Strong lines and marks f1, pale lines f2 and f3; dotted 1e-6. `Ritz` and `ForceRitz` coincide on a uniform rod.",
            "### What to choose",
            choice(scenes, errors),
            "`LoadRitz` follows what inertia does, and its tension ends in zero at a free tip: for a `TipForce` take "
            "`ForceRitz`, whose first shape is its static answer. For slow, steady loads compare the table of spin at the end.",
            "### The reference against closed forms",
            "Roots r of the rod held and R free: κ cot κ = 1 − r / R, with κ = ω length / √(E / ρ); body of mass M at the "
            "tip of a uniform rod of mass m: κ tan κ = m / M; step in the middle: tan²(κ / 2) = A_root / A_tip; a pivot "
            "inside holds two rods. Solved by bracketing, apart from this library.",
            closed_forms(scenes, exact),
            "### Errors of f1, f2, f3",
            f"Relative. Then the smallest n whose error is at most {WANTED:.0e}, and the decades that a shape adds: least "
            f"squares of log10(error) against n, down to the first below {FLOOR:.0e}.",
            table(scenes, errors),
            "### Spin",
            "Relative error of the tip's steady stretch, `jaxrod.equilibrium(system, spin=...)` without gravity against "
            "`jaxrod.continuum.steady_spin`, at parts of the exact critical rate.",
            spin(),
        ]
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    report.write("shapes", text, arguments.out / "accuracy.md")
    picture(scenes, errors).savefig(arguments.out / "convergence.png", dpi=130)


if __name__ == "__main__":
    main()
