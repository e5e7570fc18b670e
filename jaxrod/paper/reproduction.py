"""The seed of this library, reproduced and corrected.

V. S. Vikhrenko, R. N. Lasovsky, A. Yu. Tishevich, "A simplified model of the motion of an elastic rod" (in Russian),
Belarusian State Technological University, 2013.  Equation numbers are the paper's.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..continuum.neglected import model_limits
from ..mechanics.system import System, check_system
from ..motions.motion import Rotation
from ..rods.lumped import Lumped
from ..rods.rod import Rod
from ..rods.section import Cone
from ..runs.solution import Solution
from ..shapes.basis import Ritz
from ..simulation import simulate

# Figure 2: a rubber rod turning about a horizontal axis through its thin end.  psi(0) and eps(0) are not printed; 0 is
# the natural reading.
LENGTH, THIN, THICK, YOUNG, DENSITY, GRAVITY, SPIN = 1.0, 0.02, 0.03, 1e7, 1200.0, 9.81, 15.0
DURATION = 10.0
SAMPLES = 20_001


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
    check_system(system)
    ts = jnp.linspace(0.0, DURATION, SAMPLES)
    return simulate(system, system.state(angle=0.0, rate=SPIN), ts=ts)


def both() -> dict[str, Solution]:
    """Figure 2 as printed and corrected."""
    return {"as printed": figure_2(literal()), "corrected": figure_2(corrected())}


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
    limits = model_limits(corrected())
    return [
        (
            "bending",
            f"first frequency {np.asarray(limits.bending_frequencies)[0]:.2f} Hz (hinged at the thin end), beside "
            f"{limits.axial_frequency:.1f} Hz axial and {SPIN / (2 * math.pi):.2f} Hz of spin: this rod would not stay "
            "straight",
        ),
        (
            "lateral inertia",
            f"lowers the axial frequency by {100 * float(limits.lateral_inertia):.4f} % (Poisson's ratio 0.5)",
        ),
        ("large strain", "Hooke's law is taken for any strain; here it stays below 2.5 %"),
    ]
