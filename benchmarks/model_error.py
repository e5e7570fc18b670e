"""What a basis of n shapes gets wrong in motion, against the exact rod: release, steady spin, rotor, stiff limits.

    python benchmarks/model_error.py [--out docs]

The reference is `jaxrod.continuum`.  Beside each error stands the figure found by another program (Galerkin's method in
polynomials, against closed forms and 80 exact modes).  Writes model_error.md and limits.png to the folder.
"""

import argparse
import pathlib
from typing import Any

import jaxrod

jaxrod.configure()

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from report import machine, table  # noqa: E402

CONES = {"uniform": (1.0, 1.0), "root 2, tip 3": (2.0, 3.0), "root 3, tip 2": (3.0, 2.0)}
NUMBERS = {"length": 1.0, "young": 1e7, "density": 1200.0}

# Largest error of the tip over its initial displacement on tau <= 4, rms there, largest on tau <= 40; by n.
RELEASE = {
    1: ("0.544 0.280 2.00", "0.891 0.443 1.94", "0.433 0.186 1.93"),
    2: ("0.328 0.159 0.390", "0.355 0.177 0.391", "0.360 0.124 0.770"),
    3: ("0.170 0.078 0.367", "0.128 0.063 0.308", "0.203 0.080 0.281"),
    4: ("0.156 0.055 0.173", "0.114 0.049 0.172", "0.156 0.060 0.175"),
    8: ("0.052 0.020 0.092", "0.071 0.021 0.086", "0.071 0.022 0.075"),
    16: ("0.022 0.0075 0.035", "0.027 0.0078 0.042", "0.022 0.0073 0.035"),
    24: ("0.023 0.0043 0.024", "0.012 0.0041 0.021", "0.017 0.0044 0.024"),
}
# The same of n = 1 with the paper's stiffness, that of its cone in series.
RELEASE_SERIES = ("0.544 0.280 2.00", "0.784 0.388 1.73", "0.239 0.147 1.42")
# Slow spin: error of the change of the moment of inertia, %, of n = 1.
INERTIA = ("-16.7", "-28.3", "-8.8")
# Relative error of the tip's stretch of n = 1, by the spin over the critical one.
SPIN = {
    0.1: ("-0.17", "-13.0", "+7.3"),
    0.3: ("-1.61", "-15.1", "+6.5"),
    0.5: ("-5.27", "-20.4", "+4.4"),
    0.7: ("-14.0", "-31.8", "-0.9"),
    0.9: ("-42.4", "-61.2", "-22.6"),
}
# |d psi| at 2 s, largest |d omega|, rms of the tip's error over its standard deviation, on [0, 2] s; by n.
ROTOR = {
    1: ("2.3e-1 .96 1.32", "5.0e-3 4.2e-2 1.04", "1.0e-1 .70 1.42"),
    2: ("1.0e-4 9.8e-3 2.2e-2", "4.6e-6 2.3e-4 3.6e-3", "4.4e-3 .31 .58"),
    3: ("1.3e-5 3.0e-3 1.7e-2", "6.4e-7 4.3e-5 3.3e-4", "2.2e-5 6.6e-3 2.2e-2"),
    4: ("3.8e-6 1.6e-3 1.6e-2", "5.8e-9 6.3e-7 6.8e-5", "1.6e-6 8.9e-4 1.5e-2"),
    6: ("2.9e-8 2.5e-5 7.9e-4", "<1e-10 1.6e-7 2.4e-5", "2.5e-8 4.1e-5 1.9e-3"),
    12: ("<1e-10 4.5e-7 5.8e-5", "<2e-11 2.0e-9 1.4e-6", "<1e-10 2.9e-7 7.2e-5"),
}
# By E, errors of the angle after 10 s.  Against uniform strain from no stretch: rigid, quasi-static with the same angular
# momentum, with the same rate; against uniform strain that starts where it follows its loads: rigid, quasi-static.
LIMITS = {
    1e7: ("+3.09", "-2.3e-2", "+3.14", "-4.6e-2", "+4.5e-4"),
    1e8: ("+3.41e-1", "-2.3e-4", "+3.45e-1", "-4.8e-3", "+5.2e-6"),
    1e9: ("+3.42e-2", "-1.7e-6", "+3.47e-2", "-4.8e-4", "+5.3e-8"),
    1e10: ("+3.42e-3", "-2.1e-8", "+3.47e-3", "-", "-"),
    2e11: ("+1.71e-4", "-5.9e-10", "+1.73e-4", "-", "-"),
}
LIMIT_NAMES = (
    "rigid", "quasi-static, same momentum", "quasi-static, same rate", "rigid, steady start", "quasi-static, steady start",
)  # fmt: skip
RATE, UNTIL = 15.0, 10.0


def system(section, motion, basis=None, gravity=None, **numbers):
    given: dict[str, Any] = {**NUMBERS, **numbers}
    return jaxrod.System(jaxrod.Rod(section=section, **given), motion, basis, gravity)


def release_table():
    """The rod let go from uniform strain, its root held and not turning; time in travel times of a wave."""
    held, rows, series = jaxrod.Driven(lambda t: 0.0 * t), [], ["1, in series"]
    unit = {"length": 1.0, "young": 1.0, "density": 1.0}
    tau = jnp.linspace(0.005, 40.0, 8000)
    near = np.asarray(tau) <= 4 + 1e-9
    scenes = [system(jaxrod.Cone(*radii), jaxrod.Rotation(), **unit) for radii in CONES.values()]
    exact = [jaxrod.continuum.release(scene, jnp.asarray(0.01), tau, n=1000) for scene in scenes]

    def errors(tip, true):
        error = np.abs(np.asarray(tip - true)) / 0.01
        return " ".join(f"{x:.3g}" for x in (error[near].max(), np.sqrt(np.mean(error[near] ** 2)), error.max()))

    for n, published in RELEASE.items():
        row = [str(n)]
        for radii, true, other in zip(CONES.values(), exact, published, strict=True):
            rung = system(jaxrod.Cone(*radii), held, jaxrod.Ritz(n), **unit)
            tip = jaxrod.simulate(rung, rung.state(strain=0.01), ts=tau).tip[:, 0] - 1  # along the director
            row += [errors(tip, true), other]
        rows.append(row)
    for scene, true, other in zip(scenes, exact, RELEASE_SERIES, strict=True):
        rod: Any = scene.rod
        s, ds = rod.quadrature()
        rate = jnp.sqrt(1 / jnp.sum(ds / rod.area(s)) / scene.body.mass_matrix[0, 0])
        series += [errors(0.01 * jnp.cos(rate * tau), true), other]
    return [series, *rows]


def inertia_table():
    """Turning slowly: by how much stretching changes the moment of inertia, which makes the angle drift."""
    rows = []
    for (name, radii), other in zip(CONES.items(), INERTIA, strict=True):
        rod: Any = system(jaxrod.Cone(*radii), jaxrod.Rotation()).rod
        x = np.linspace(0.0, 1.0, 20001)
        area = np.asarray(rod.area(jnp.asarray(x)))
        beyond = (
            np.cumsum((area * x)[::-1])[::-1] - area * x / 2
        )  # in steps of x; the tip's own half step is left out below
        beyond = (beyond - area[-1] / 2) * x[1]
        u = np.concatenate([[0.0], np.cumsum((beyond / area)[1:] + (beyond / area)[:-1]) * x[1] / 2])
        exact = np.trapezoid(area * x * u, x) / 1e7 * 1200.0**2  # half of dJ over the rate squared
        errors = []
        for n in (1, 2, 3):
            body = system(jaxrod.Cone(*radii), jaxrod.Rotation(), jaxrod.Ritz(n)).body
            still = jnp.linalg.solve(body.stiffness_matrix, body.mass_matrix[1:, 0])
            errors.append(float(body.mass_matrix[0, 1:] @ still / exact) - 1)
        rows.append([name, f"{100 * errors[0]:+.1f} %", f"{other} %", *(f"{x:+.0e}" for x in errors[1:])])
    return rows


def spin_table():
    """The tip's stretch in a steady prescribed spin."""
    rows = []
    for fraction, published in SPIN.items():
        row = [f"{fraction:g}"]
        for radii, other in zip(CONES.values(), published, strict=True):
            section = jaxrod.Cone(*radii)
            rate = fraction * jaxrod.continuum.critical_rate(system(section, jaxrod.Rotation()))
            exact = jaxrod.continuum.steady_spin(system(section, jaxrod.Rotation()), rate)
            errors = []
            for n in (1, 2, 3, 4):
                rung = system(section, jaxrod.Rotation(), jaxrod.Ritz(n))
                tip = rung.tip(jaxrod.equilibrium(rung, spin=rate))
                errors.append(float((jnp.sqrt(tip @ tip) - 1) / exact) - 1)
            row += [f"{100 * errors[0]:+.2f} %", f"{other} %", *(f"{x:+.0e}" for x in errors[1:])]
        rows.append(row)
    return rows


def rotor_table():
    """A rod swung round under gravity, 15 rad/s at the start, from no stretch or from the static one."""
    ts, rows, exact, spread = jnp.linspace(0.005, 2.0, 400), [], {}, {}
    cases = {
        "sudden": (jaxrod.Cone(0.02, 0.03), 0.0, False),
        "steady": (jaxrod.Cone(0.02, 0.03), 0.0, True),
        "uniform": (jaxrod.Uniform(0.025), 0.0, False),
    }
    worst = 0.0
    for name, (section, angle, static) in cases.items():
        scene = system(section, jaxrod.Rotation(), gravity=9.81)
        run = jaxrod.continuum.simulate(scene, scene.state(angle=angle, rate=RATE), ts=ts, static=static, modes=128)
        exact[name], spread[name] = run, float(np.std(run.tip_stretch))
        assert run.error is not None
        worst = max(worst, float(run.error.angle.max()))
    for n, published in ROTOR.items():
        row = [str(n)]
        for (name, (section, angle, static)), other in zip(cases.items(), published, strict=True):
            rung, run = system(section, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81), exact[name]
            start = rung.state(angle=angle, rate=RATE)
            start = jaxrod.ladder.at_rest(rung, start) if static else start
            sol = jaxrod.simulate(rung, start, ts=ts, tolerance=1e-12)
            stretch = jnp.sum(sol.tip * sol.director, axis=1) - 1 - run.tip_stretch
            found = (
                abs(float(sol.angle[-1] - run.angle[-1])),
                float(jnp.max(jnp.abs(sol.rate - run.rate))),
                float(jnp.sqrt(jnp.mean(stretch**2))) / spread[name],
            )
            row += [" ".join(f"{x:.1e}" for x in found), other]
        rows.append(row)
    return rows, worst


def limit_table():
    """Figure 2 with ever stiffer rods, 10 s: angle at the end less that of uniform strain, and what closed forms foretell."""
    rows, points = [], []
    for young, published in LIMITS.items():

        def end(basis, rate=RATE, static=False, young=young):
            scene = system(jaxrod.Cone(0.02, 0.03), jaxrod.Rotation(), basis, gravity=9.81, young=young)
            start = scene.state(rate=rate)
            start = jaxrod.ladder.at_rest(scene, start) if static else start
            run = jaxrod.simulate(scene, start, t1=UNTIL, tolerance=1e-12, max_steps=2**24)
            return float(run.angle[-1])

        condensed = jaxrod.QuasiStatic(jaxrod.Ritz(1))  # pyright: ignore[reportCallIssue] n is a property of it
        full = system(jaxrod.Cone(0.02, 0.03), jaxrod.Rotation(), jaxrod.Ritz(1), gravity=9.81, young=young)
        # A quasi-static start has the angular momentum of the unstretched state: one of the same rate has more.
        faster = RATE * float(1 + jaxrod.ladder.at_rest(full, full.state(rate=RATE)).strain) ** 2
        sudden, steady = end(jaxrod.Ritz(1)), end(jaxrod.Ritz(1), static=True)
        rigid, momentum, rate = end(jaxrod.Ritz(0)), end(condensed), end(condensed, faster)
        delta = float((RATE / (2 * np.pi * jaxrod.natural_frequencies(full)[0])) ** 2)
        errors = rigid - sudden, momentum - sudden, rate - sudden, rigid - steady, rate - steady
        points.append((delta, sudden, *map(abs, errors)))
        beside = [x for error, other in zip(errors, published, strict=True) for x in (f"{error:+.2e}", other)]
        rows.append([f"{young:.0e}", f"{delta:.1e}", *beside])
    return rows, np.array(points)


def picture(points, path):
    """Marks: errors against uniform strain, hollow where they are not in the fit; lines: fitted powers; dashed: what the closed
    forms foretell of a sudden start."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes, slopes = figure.subplots(), []
    delta, angle = points[:, 0], points[:, 1]
    fitted = slice(1, 4)  # beyond: no limit, a bounded part
    looks = (
        (2, "rigid", "#1f5fa8", "o"), (3, "quasi-static, same momentum", "#d9661f", "o"),
        (5, "rigid, started steadily", "#1f5fa8", "^"), (6, "quasi-static, started steadily", "#d9661f", "^"),
    )  # fmt: skip
    for column, name, color, mark in looks:
        error = points[:, column]
        seen = error > 1e-10
        slope, height = np.polyfit(np.log10(delta[fitted]), np.log10(error[fitted]), 1)
        slopes.append(slope)
        axes.loglog(delta[seen], error[seen], mark, color=color, fillstyle="none")
        axes.loglog(delta[fitted], error[fitted], mark, color=color, label=f"{name}: power {slope:.2f}")
        axes.loglog(delta, 10**height * delta**slope, color=color, linewidth=0.8)
    axes.loglog(delta, 2 * delta * angle, "--", color="#888888", linewidth=1.2, label="2 δ · angle")
    bounded = 1.5 * delta**2 * angle + 2 * delta**1.5
    axes.loglog(delta, bounded, ":", color="#888888", linewidth=1.2, label="3/2 δ² · angle + 2 δ^(3/2)")
    axes.set(
        xlabel="δ = (rate / strain frequency)²",
        ylabel="angle after 10 s, off uniform strain by (rad)",
        ylim=(1e-11, None),
    )
    axes.legend(fontsize=7)
    figure.savefig(path, dpi=120)
    return slopes


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default=str(pathlib.Path(__file__).parent.parent / "docs"))
    out = pathlib.Path(parser.parse_args().out)
    rotor, worst = rotor_table()
    limits, points = limit_table()
    slopes = picture(points, out / "limits.png")
    by_cone = [x for name in CONES for x in (name, "elsewhere")]
    spins = [x for name in CONES for x in (f"{name}, n = 1", "elsewhere", "2", "3", "4")]
    text = f"""# What a basis gets wrong in motion

Written by `python benchmarks/model_error.py`. {machine()}

`Ritz(n)` against the exact rod (`jaxrod.continuum`); "elsewhere" is what another program found: polynomials of degree n
against closed forms and 80 exact modes.

## Let go from uniform strain

Tip over its initial displacement: largest error and rms in four travel times of a wave, largest in forty. The exact
motion has kinks, so errors fall as 1 / n; against the series of 1000 terms, itself good to 2e-4.

{table(["n", *by_cone], release_table())}

"In series" is n = 1 with the paper's stiffness, E / (integral of ds / A).

## Steady spin

Stretch of the tip in a prescribed spin, by its rate over the exact rod's critical one: error of n = 1, and of 2, 3 and 4.

{table(["rate", *spins], spin_table())}

Turning slowly, by how much n = 1, 2 and 3 are off in what stretching does to the moment of inertia, on which the angle
depends (the exact one by quadrature of N = ρ Ω² ∫ A s ds):

{table(["rod", "n = 1", "elsewhere", "2", "3"], inertia_table())}

## Swung round under gravity

The paper's rod and its uniform companion, 15 rad/s at the start, for 2 s: error of the angle at the end (rad), the largest of
the rate (rad/s), rms of that of the tip's stretch over its standard deviation. Sudden: from no stretch; steady: from the
static one. By its own estimate the exact rod's angle is known to {worst:.0e} rad (128 modes against 64).

{table(["n", "cone, sudden", "elsewhere", "cone, steady", "elsewhere", "uniform, sudden", "elsewhere"], rotor)}

## Stiff rods

The paper's rod with larger moduli: angle after 10 s less that of uniform strain, δ = (rate / strain frequency)². From no
stretch the rigid rod is off by 2 δ · angle, the quasi-static one by 3/2 δ² · angle, which grows, and by 2 δ^(3/2), which does
not, if it starts with the same angular momentum; with the same rate it is as bad as the rigid one. Where uniform strain
starts stretched as its loads would hold it, both are better, the quasi-static one (of the same rate) by far. So the three
rungs approach one another; fitted powers of δ from 1e8 to 1e10 Pa: {", ".join(f"{x:.2f}" for x in slopes)}, in the order of
the picture's legend.

{table(["E, Pa", "δ", *[x for name in LIMIT_NAMES for x in (name, "elsewhere")]], limits)}

![Rigid and quasi-static rods against δ](limits.png)

Hollow marks are not in the fit: of the stiffest rod what does not grow is seen, of the softest δ is not small.
"""
    (out / "model_error.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
