"""Each sentence of the paper that can be checked, measured on its own scene; and the report of `jaxrod paper`."""

import math
import pathlib
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import continuum, plot
from ..core import tracing
from ..mechanics import vibration
from ..mechanics.system import System
from ..motions.motion import Flight, Rotation
from ..motions.state import State
from ..rods.lumped import Lumped
from ..rods.rod import Rod
from ..rods.section import Cone
from ..runs.solution import Solution
from ..shapes.basis import Ritz
from ..simulation import simulate
from . import reproduction

_INNER = slice(reproduction.SAMPLES // 10, -reproduction.SAMPLES // 10)  # where bands do not ring from the ends
_SPLIT = 12.0  # Hz, between the turns (2.3 Hz and its harmonics) and the strain oscillation (23 Hz)


class Claim(NamedTuple):
    """A sentence of the paper, what was measured, and whether it holds."""

    sentence: str
    measured: str
    verdict: str


def split_bands(ts: Any, signal: Any) -> tuple[np.ndarray, np.ndarray]:
    """A signal's slow band (turning, gravity) and fast band (strain oscillation), divided at 12 Hz."""
    ts, signal = np.asarray(ts), np.asarray(signal)
    spectrum = np.fft.rfft(signal - signal.mean())
    spectrum[np.fft.rfftfreq(signal.size, float(ts[1] - ts[0])) > _SPLIT] = 0.0
    slow = signal.mean() + np.fft.irfft(spectrum, signal.size)
    return slow, signal - slow


def frequency(ts: Any, signal: np.ndarray) -> float:
    """Frequency in Hz of the largest peak of a signal's spectrum, between the lines by a parabola through its log."""
    ts, padded = np.asarray(ts), 8 * signal.size
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(signal.size), padded))
    peak = int(np.argmax(spectrum))
    left, top, right = np.log(spectrum[peak - 1 : peak + 2])
    offset = (left - right) / (left - 2 * top + right) / 2
    return (peak + offset) / (padded * float(ts[1] - ts[0]))


def measured(runs: dict[str, Solution], tips: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[Claim]:
    """Each sentence of the paper that can be checked, measured on its own scene: `runs` of `both()`, `tips` of `released()`."""
    return [
        _energy(runs),
        _oscillation(runs),
        *_antiphase(runs),
        *_slow_period(runs),
        _plane_motion(),
        *_frequency_error(runs),
        _release_picture(tips),
        _slow_loads(),
    ]


def report(folder: pathlib.Path) -> str:
    """Writes the pictures, their data and the tables to `folder`, and returns the tables as Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    runs = reproduction.both()
    titles = {"as printed": "as printed: (14), arm l0/2", "corrected": "corrected: E V / l0², arm x_C"}
    slow = {
        title: tuple(split_bands(runs[name].ts, signal)[0] for signal in (runs[name].rate, runs[name].strain))
        for name, title in titles.items()
    }
    columns = {title: runs[name] for name, title in titles.items()}
    plot.bands(columns, slow, until=2.0).savefig(folder / "figure2.png", dpi=130)
    tau, tips = released()
    plot.release(tau, tips).savefig(folder / "release.png", dpi=130)
    for name, sol in zip(("literal", "corrected"), runs.values(), strict=True):
        table = np.stack([sol.ts, sol.angle, sol.rate, sol.strain], axis=1)
        header = "t [s],angle [rad],rate [rad/s],strain"
        np.savetxt(folder / f"figure2_{name}.csv", table, "%.12g", delimiter=",", header=header, comments="")
    text = "\n\n".join(
        [
            "## What the paper says, measured",
            _markdown(("The paper", "Measured here", "Verdict"), measured(runs, tips)),
            "## Its slips",
            _markdown(("Where", "Printed", "Right"), reproduction.slips()),
            "## What the model leaves out",
            "\n".join(f"- **{name}**: {what}." for name, what in reproduction.omissions()),
        ]
    )
    (folder / "claims.md").write_text(text + "\n", encoding="utf-8")
    return text


def _markdown(head, rows) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _bound(found: float) -> float:
    """The next of 1e-11, 1e-8, 1e-5, ...: steps so wide that another machine's rounding prints the same."""
    return 10.0 ** (3 * math.ceil((math.log10(found) - 1) / 3) + 1)


def _energy(runs) -> Claim:
    drift = []
    for sol in runs.values():
        energy, weight = map(np.asarray, _energy_and_weight(sol.system, sol.states))
        drift.append(np.max(np.abs(energy - energy[0])) / np.max(energy - weight + np.abs(weight)))
    return Claim(
        "The mechanical energy stayed constant.",
        f"over {reproduction.DURATION:.0f} s to better than {_bound(max(drift)):.0e} of itself",
        "holds; but any potential conserves some energy: the check cannot see the slips in (14), (15)",
    )


@tracing.run_seldom
def _energy_and_weight(system: System, states: State) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
    return jax.vmap(lambda state: (system.energy(state), system.gravity_energy(state)))(states)


def _oscillation(runs) -> Claim:
    parts = []
    for name, sol in runs.items():
        _, fast = split_bands(sol.ts, sol.strain)
        measured = 2 * math.pi * frequency(sol.ts, fast)
        at_rest = 2 * math.pi * float(vibration.natural_frequencies(sol.system)[0])
        spun = math.sqrt(at_rest**2 + 3 * float(np.mean(np.asarray(sol.rate) ** 2)))
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
        turn = 2 * math.pi * reproduction.DURATION / np.asarray(sol.angle)[-1]
        parts.append(f"{name}: {1 / frequency(sol.ts, slow):.3f} s (one turn: {turn:.3f} s)")
    weightless = reproduction.figure_2(reproduction.corrected(gravity=0.0))
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
    flying = System(reproduction.rod(), Flight(), Ritz(1), reproduction.GRAVITY)
    inertia, stiffness = _about_center(reproduction.rod())
    turning = System(Lumped(inertia, 0.0, stiffness, reproduction.LENGTH), Rotation(), Ritz(1), reproduction.GRAVITY)
    ts = jnp.linspace(0.0, 1.0, reproduction.SAMPLES)  # as many as in Figure 2: one compiled program runs both
    off = max(
        float(np.max(np.abs(np.asarray(getattr(flight, name)) - np.asarray(getattr(turn, name)))))
        for flight, turn in [[simulate(x, x.state(rate=reproduction.SPIN), ts=ts) for x in (flying, turning)]]
        for name in ("angle", "strain")
    )
    return Claim(
        "(5) with another inertia describes plane motion.",
        f"a flight and a rotation with I_C agree to {_bound(off):.0e} in angle and strain over 1 s",
        "holds, if (15) is left out: gravity moves the centre of mass alone",
    )


@tracing.run_seldom
def _about_center(rod: Rod) -> tuple[Float[Array, ""], Float[Array, ""]]:
    return rod.moment_of_inertia(rod.center_of_mass), rod.stiffness


def _weightless() -> dict[str, System]:
    """The uniform rod of the paper's last paragraph, and its cone, without gravity."""
    # Not Uniform and no gravity but numbers of the same kind as in Figure 2: one compiled program runs all of them.
    mean = (reproduction.THIN + reproduction.THICK) / 2
    sections = {"uniform rod": Cone(mean, mean), "the paper's cone": Cone(reproduction.THIN, reproduction.THICK)}
    rods = {
        name: Rod(reproduction.LENGTH, section, reproduction.YOUNG, reproduction.DENSITY)
        for name, section in sections.items()
    }
    return {name: System(rod, Rotation(), Ritz(1), gravity=0.0) for name, rod in rods.items()}


def _frequency_error(runs) -> list[Claim]:
    uniform, cone = _weightless().values()
    by_strain = float(vibration.frequency_error(cone)[0])
    exact = float(continuum.natural_frequencies(cone, 1)[0])
    by_force = 100 * (float(vibration.natural_frequencies(runs["as printed"].system)[0]) / exact - 1)
    return [
        Claim(
            "The model's frequency is √(12/π²) ≅ 1.1 times the exact one.",
            f"uniform rod: {math.sqrt(12) / math.pi:.4f}, {float(vibration.frequency_error(uniform)[0]):.2f} % too high",
            "holds for the uniform rod",
        ),
        Claim(
            "The error of the frequency is about 10 %.",
            f"its own cone: {by_force:.1f} % as printed, {by_strain:.1f} % corrected",
            "does not hold for the paper's own rod",
        ),
    ]


def released() -> tuple[np.ndarray, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Tips let go from uniform stretch: exact series and simulated model, over four travel times of a wave."""
    strain, tau, tips = 0.01, np.linspace(0.0, 4.0, reproduction.SAMPLES), {}  # as many as in Figure 2, for its program
    shown = slice(None, None, reproduction.SAMPLES // 800)
    for name, system in _weightless().items():
        ts = tau * reproduction.LENGTH / math.sqrt(reproduction.YOUNG / reproduction.DENSITY)
        exact = continuum.release(system, jnp.asarray(strain), jnp.asarray(ts[shown]))
        model = np.asarray(simulate(system, system.state(strain=strain), ts=ts).strain)[shown]
        tips[name] = (np.asarray(exact) / (strain * reproduction.LENGTH), model / strain)
    return tau[shown], tips


def _release_picture(tips) -> Claim:
    off = {name: float(np.max(np.abs(exact - model))) for name, (exact, model) in tips.items()}
    return Claim(
        "After release from uniform stretch the exact motion differs in detail: it is no harmonic.",
        "; ".join(f"{name}: tip off by up to {x:.2f} of the initial stretch" for name, x in off.items())
        + " in four wave travels",
        "holds (release.png)",
    )


def _slow_loads() -> Claim:
    parts = []
    for name, system in _weightless().items():
        square = (2 * math.pi * float(vibration.natural_frequencies(system)[0])) ** 2
        model = reproduction.SPIN**2 / (square - reproduction.SPIN**2)
        exact = float(continuum.steady_spin(system, jnp.asarray(reproduction.SPIN))) / reproduction.LENGTH
        parts.append(f"{name}: {100 * (model / exact - 1):+.1f} %")
    return Claim(
        "For slowly changing loads the accuracy is acceptable.",
        f"stretch of the tip at a steady {reproduction.SPIN:.0f} rad/s; " + "; ".join(parts),
        "holds for the uniform rod; on a cone an error of shape stays however slow the load",
    )
