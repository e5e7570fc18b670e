"""The seed of this library, reproduced and corrected.

V. S. Vikhrenko, R. N. Lasovsky, A. Yu. Tishevich, "A simplified model of the motion of an elastic rod" (in Russian),
Belarusian State Technological University, 2013.  Equation numbers are the paper's.
"""

import math
import pathlib
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import continuum, modal, plot
from .basis import Ritz
from .motion import Flight, Rotation
from .rod import Cone, Lumped, Rod, Uniform
from .simulation import simulate
from .solution import Solution
from .system import System

# Figure 2: a rubber rod turning about a horizontal axis through its thin end.  psi(0) and eps(0) are not printed; 0 is
# the natural reading.
LENGTH, THIN, THICK, YOUNG, DENSITY, GRAVITY, SPIN = 1.0, 0.02, 0.03, 1e7, 1200.0, 9.81, 15.0
DURATION = 10.0
_SAMPLES = 20_001
_INNER = slice(_SAMPLES // 10, -_SAMPLES // 10)  # where bands do not ring from the ends
_SPLIT = 12.0  # Hz, between the turns (2.3 Hz and its harmonics) and the strain oscillation (23 Hz)


class Claim(NamedTuple):
    """A sentence of the paper, what was measured, and whether it holds."""

    sentence: str
    measured: str
    verdict: str


class Slip(NamedTuple):
    """A place of the paper, what is printed there, and what is right."""

    place: str
    printed: str
    right: str


def rod() -> Rod:
    """The rod of Figure 2: a rubber cone, its thin end at the axis."""
    return Rod(LENGTH, Cone(THIN, THICK), YOUNG, DENSITY)


def literal(gravity: float = GRAVITY) -> System:
    """Figure 2 as printed: inertia (16), stiffness (14), and in (15) the arm l0/2."""
    r, big, mass = THIN, THICK, math.pi * DENSITY * LENGTH * (THICK**2 + THICK * THIN + THIN**2) / 3
    inertia = mass * LENGTH**2 / 10 * (6 * big**2 + 3 * big * r + r**2) / (big**2 + big * r + r**2)  # (16)
    stiffness = math.pi * r * big / LENGTH * YOUNG  # (14)
    body = Lumped(inertia, first_moment=mass * LENGTH / 2, stiffness=stiffness * LENGTH**2, length=LENGTH)
    return System(body, Rotation(), Ritz(1), gravity)


def corrected(gravity: float = GRAVITY) -> System:
    """Figure 2 with the stiffness that belongs to uniform strain, E V / l0^2, and the true centre of mass."""
    return System(rod(), Rotation(), Ritz(1), gravity)


def figure_2(system: System) -> Solution:
    """The motion of Figure 2, 10 s at 2 kHz."""
    ts = jnp.linspace(0.0, DURATION, _SAMPLES)
    return simulate(system, system.state(angle=0.0, rate=SPIN), ts=ts)


def split_bands(ts: Float[Array, " T"], signal: Float[Array, " T"]) -> tuple[np.ndarray, np.ndarray]:
    """A signal's slow band (turning, gravity) and fast band (strain oscillation), divided at 12 Hz."""
    signal = np.asarray(signal)
    spectrum = np.fft.rfft(signal - signal.mean())
    spectrum[np.fft.rfftfreq(signal.size, float(ts[1] - ts[0])) > _SPLIT] = 0.0
    slow = signal.mean() + np.fft.irfft(spectrum, signal.size)
    return slow, signal - slow


def frequency(ts: Float[Array, " T"], signal: np.ndarray) -> float:
    """Frequency in Hz of the largest peak of a signal's spectrum, between the lines by a parabola through its log."""
    padded = 8 * signal.size
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(signal.size), padded))
    peak = int(np.argmax(spectrum))
    left, top, right = np.log(spectrum[peak - 1 : peak + 2])
    offset = (left - right) / (left - 2 * top + right) / 2
    return (peak + offset) / (padded * float(ts[1] - ts[0]))


def both() -> dict[str, Solution]:
    """Figure 2 as printed and corrected."""
    return {"as printed": figure_2(literal()), "corrected": figure_2(corrected())}


def claims(runs: dict[str, Solution]) -> list[Claim]:
    """Each sentence of the paper that can be checked, measured on its own scene; `runs` are those of `both()`."""
    return [
        _energy(runs),
        _oscillation(runs),
        *_antiphase(runs),
        *_slow_period(runs),
        _plane_motion(),
        *_frequency_error(),
        _release_picture(),
        _slow_loads(),
    ]


def slips() -> list[Slip]:
    """The paper's slips, each with its correction and what it changes."""
    r, big, length = THIN, THICK, LENGTH
    series = math.pi * r * big * YOUNG / length
    energy = float(rod().stiffness) / length**2
    arm = float(rod().center_of_mass)
    inverted = YOUNG * length / (math.pi * r * big)
    return [
        Slip(
            "(9), second equation",
            "third term with (1 + ε)",
            "(1 + ε)²; as printed neither energy nor L_z is conserved",
        ),
        Slip("before (10)", "Q_ε and Q_φ", "Q_ε and Q_ψ; in spherical motion Q_φ = 0"),
        Slip("(10)", "ε constant, then F / (A E)", "for a varying section the two contradict each other"),
        Slip("(11)", "upper limit l", "l0: x0 is a material coordinate"),
        Slip("(12)", f"c = E ∫dx/A ({inverted:.2g} Pa/m here)", f"c = E / ∫dx/A = {series:.5g} N/m"),
        Slip(
            "(14)",
            f"c = π r R E / l0 = {series:.5g} N/m",
            f"of constant force; for uniform strain (2): E V / l0² = {energy:.5g} N/m, {100 * (energy / series - 1):.1f} % more",
        ),
        Slip(
            "(15)",
            "arm of the weight l0/2",
            f"x_C = {arm:.5f} m; the torque is {100 * (1 - 0.5 / arm):.1f} % too small",
        ),
        Slip("(15) with (16)", "(16) is about the thin end", "then l0/2 in (15) cannot be; it holds for r = R alone"),
        Slip(
            "(15) for plane motion (6)",
            "(5) with another inertia",
            "true, but gravity then moves the centre of mass alone",
        ),
        Slip("Figure 2", "E = 10⁷ MPa", "E = 10⁷ Pa: with 10¹³ Pa the strain would be 10⁻⁸; ψ(0), ε(0) are not given"),
        Slip(
            "last paragraph", "(5), (15) at ψ = 0", "no equilibrium under gravity; ψ' = 0 and g = 0 are meant; l is l0"
        ),
    ]


def omissions() -> list[tuple[str, str]]:
    """What the model leaves out, with numbers for the rod of Figure 2."""
    mean = (THIN + THICK) / 2
    bending = 3.926602312**2 * (mean / 2) * float(rod().wave_speed) / LENGTH**2 / (2 * math.pi)  # tan x = tanh x
    axial = float(continuum.natural_frequencies(corrected(), 1)[0])
    kappa = 2 * math.pi * axial * LENGTH / float(rod().wave_speed)
    lateral = 0.5**2 * kappa**2 * mean**2 / (4 * LENGTH**2)
    return [
        (
            "bending",
            f"first frequency {bending:.2f} Hz (pinned and free, uniform rod of the mean radius), beside {axial:.1f} Hz "
            f"axial and {SPIN / (2 * math.pi):.2f} Hz of spin: this rod would not stay straight",
        ),
        ("lateral inertia", f"lowers the axial frequency by {100 * lateral:.4f} % (Poisson's ratio 0.5)"),
        ("large strain", "Hooke's law is taken for any strain; here it stays below 2.5 %"),
    ]


def report(folder: pathlib.Path) -> str:
    """Writes the pictures, their data and the tables to `folder`, and returns the tables as Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    runs = both()
    titles = {"as printed": "as printed: (14), arm l0/2", "corrected": "corrected: E V / l0², arm x_C"}
    slow = {
        title: tuple(split_bands(runs[name].ts, signal)[0] for signal in (runs[name].rate, runs[name].strain))
        for name, title in titles.items()
    }
    columns = {title: runs[name] for name, title in titles.items()}
    plot.bands(columns, slow, until=2.0).savefig(folder / "figure2.png", dpi=130)
    tau, tips = _released()
    plot.release(tau, tips).savefig(folder / "release.png", dpi=130)
    for name, sol in zip(("literal", "corrected"), runs.values(), strict=True):
        table = np.stack([sol.ts, sol.angle, sol.rate, sol.strain], axis=1)
        header = "t [s],angle [rad],rate [rad/s],strain"
        np.savetxt(folder / f"figure2_{name}.csv", table, "%.12g", delimiter=",", header=header, comments="")
    text = "\n\n".join(
        [
            "## What the paper says, measured",
            _markdown(("The paper", "Measured here", "Verdict"), claims(runs)),
            "## Its slips",
            _markdown(("Where", "Printed", "Right"), slips()),
            "## What the model leaves out",
            "\n".join(f"- **{name}**: {what}." for name, what in omissions()),
        ]
    )
    (folder / "claims.md").write_text(text + "\n", encoding="utf-8")
    return text


def _markdown(head, rows) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


# ---- the claims


def _energy(runs) -> Claim:
    drift = []
    for system, sol in runs.values():
        scale = np.max(
            sol.energy - 2 * jnp.minimum(system.gravity * system.body.first_moments[0] * jnp.sin(sol.angle), 0)
        )
        drift.append(float(np.max(np.abs(sol.energy - sol.energy[0])) / scale))
    largest = 10.0 ** math.ceil(math.log10(max(drift)))
    return Claim(
        "The mechanical energy stayed constant.",
        f"over {DURATION:.0f} s to better than {largest:.0e} of itself",
        "holds; but any potential conserves some energy: the check cannot see the slips in (14), (15)",
    )


def _oscillation(runs) -> Claim:
    parts = []
    for name, sol in runs.items():
        _, fast = split_bands(sol.ts, sol.strain)
        measured = 2 * math.pi * frequency(sol.ts, fast)
        at_rest = 2 * math.pi * float(modal.natural_frequencies(sol.system)[0])
        spun = math.sqrt(at_rest**2 + 3 * float(jnp.mean(sol.rate**2)))
        parts.append(f"{name}: {measured:.2f} rad/s; √(ω_ε² + 3⟨ω²⟩) = {spun:.2f}, ω_ε = {at_rest:.2f}")
    return Claim("The strain oscillates.", "; ".join(parts), "holds; free spin raises the frequency above ω_ε")


def _antiphase(runs) -> list[Claim]:
    parts = []
    for name, sol in runs.items():
        bands = zip(split_bands(sol.ts, sol.strain), split_bands(sol.ts, sol.rate), strict=True)
        slow, fast = (np.corrcoef(strain[_INNER], rate[_INNER])[0, 1] for strain, rate in bands)
        whole = np.corrcoef(sol.strain, sol.rate)[0, 1]
        parts.append(f"{name}: correlation {fast:.4f} fast, {slow:+.4f} slow, {whole:.2f} together")
    return [
        Claim(
            "Strain and angular velocity change in antiphase.",
            "; ".join(parts),
            "holds for the fast band alone; the slow band is in phase",
        )
    ]


def _slow_period(runs) -> list[Claim]:
    parts = []
    for name, sol in runs.items():
        slow, _ = split_bands(sol.ts, sol.rate)
        parts.append(
            f"{name}: {1 / frequency(sol.ts, slow):.3f} s (one turn: {2 * math.pi * DURATION / float(sol.angle[-1]):.3f} s)"
        )
    weightless = figure_2(corrected(gravity=0.0))
    swing = {
        name: float(np.ptp(split_bands(sol.ts, sol.strain)[0][_INNER]))
        for name, sol in (("with", runs["corrected"]), ("without", weightless))
    }
    return [
        Claim(
            "The long period of the angular velocity is about 0.4 s.",
            "; ".join(parts),
            "holds: it is the time of a turn",
        ),
        Claim(
            "Gravity causes it, and acts on the strain too.",
            f"slow swing of the strain {100 * swing['with']:.2f} % with gravity, {100 * swing['without']:.2f} % without",
            "holds",
        ),
    ]


def _plane_motion() -> Claim:
    flying = System(rod(), Flight(), Ritz(1), GRAVITY)
    body = Lumped(rod().moment_of_inertia(rod().center_of_mass), 0.0, rod().stiffness, LENGTH)
    turning = System(body, Rotation(), Ritz(1), GRAVITY)
    ts = jnp.linspace(0.0, 1.0, 101)
    off = max(
        float(jnp.max(jnp.abs(getattr(flight, name) - getattr(turn, name))))
        for flight, turn in [[simulate(x, x.state(rate=SPIN), ts=ts) for x in (flying, turning)]]
        for name in ("angle", "strain")
    )
    largest = 10.0 ** math.ceil(math.log10(off))
    return Claim(
        "(5) with another inertia describes plane motion.",
        f"a flight and a rotation with I_C agree to {largest:.0e} in angle and strain over 1 s",
        "holds, if (15) is left out: gravity moves the centre of mass alone",
    )


def _frequency_error() -> list[Claim]:
    uniform = System(Rod(LENGTH, Uniform((THIN + THICK) / 2), YOUNG, DENSITY), Rotation())
    by_strain = float(modal.frequency_error(corrected())[0])
    exact = float(continuum.natural_frequencies(corrected(), 1)[0])
    by_force = 100 * (float(modal.natural_frequencies(literal())[0]) / exact - 1)
    return [
        Claim(
            "The model's frequency is √(12/π²) ≅ 1.1 times the exact one.",
            f"uniform rod: {math.sqrt(12) / math.pi:.4f}, {float(modal.frequency_error(uniform)[0]):.2f} % too high",
            "holds for the uniform rod",
        ),
        Claim(
            "The error of the frequency is about 10 %.",
            f"its own cone: {by_force:.1f} % as printed, {by_strain:.1f} % corrected",
            "does not hold for the paper's own rod",
        ),
    ]


def _released() -> tuple[np.ndarray, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Tips let go from uniform stretch: exact series and simulated model, over four travel times of a wave."""
    strain, tau, tips = 0.01, np.linspace(0.0, 4.0, 801), {}
    for name, section in (("uniform rod", Uniform((THIN + THICK) / 2)), ("the paper's cone", Cone(THIN, THICK))):
        system = System(Rod(LENGTH, section, YOUNG, DENSITY), Rotation())
        ts = jnp.asarray(tau * LENGTH / float(system.rod.wave_speed))
        exact = continuum.release(system, strain, ts)
        model = simulate(system, system.state(strain=strain), ts=ts).strain * LENGTH
        tips[name] = (np.asarray(exact) / (strain * LENGTH), np.asarray(model) / (strain * LENGTH))
    return tau, tips


def _release_picture() -> Claim:
    _, tips = _released()
    off = {name: float(np.max(np.abs(exact - model))) for name, (exact, model) in tips.items()}
    return Claim(
        "After release from uniform stretch the exact motion differs in detail: it is no harmonic.",
        "; ".join(f"{name}: tip off by up to {x:.2f} of the initial stretch" for name, x in off.items())
        + " in four wave travels",
        "holds (release.png)",
    )


def _slow_loads() -> Claim:
    parts = []
    for name, section in (("uniform rod", Uniform((THIN + THICK) / 2)), ("the paper's cone", Cone(THIN, THICK))):
        system = System(Rod(LENGTH, section, YOUNG, DENSITY), Rotation())
        square = (2 * math.pi * float(modal.natural_frequencies(system)[0])) ** 2
        model = SPIN**2 / (square - SPIN**2)
        exact = float(continuum.steady_spin(system, jnp.asarray(SPIN))) / LENGTH
        parts.append(f"{name}: {100 * (model / exact - 1):+.1f} %")
    return Claim(
        "For slowly changing loads the accuracy is acceptable.",
        f"stretch of the tip at a steady {SPIN:.0f} rad/s; " + "; ".join(parts),
        "holds for the uniform rod; on a cone an error of shape stays however slow the load",
    )
