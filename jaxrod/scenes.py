"""Scenes with lessons about speed and accuracy."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.tree_util import Partial

from .accuracy.quantity import AbstractQuantity, FinalAngle, FinalTip, LargestStrain
from .core import validation
from .mechanics.system import System
from .motions.force import TipForce
from .motions.motion import Driven, Rotation, Spherical
from .motions.state import State
from .paper.reproduction import corrected
from .rods.rod import Rod
from .rods.section import Cone, Uniform
from .shapes.basis import Ritz


class Scene(NamedTuple):
    """A system, its start, when it ends (s), what is asked, and whether the rod starts at rest in its spin."""

    title: str
    system: System
    start: State
    t1: float
    quantity: AbstractQuantity
    static: bool = False


def cone_started_suddenly() -> Scene:
    """The paper's rubber cone, unstretched when it is set spinning."""
    system = corrected()
    return Scene("the paper's cone, started suddenly", system, system.state(rate=15.0), 2.0, FinalAngle())


def cone_started_steadily() -> Scene:
    """The same, already stretched by its spin."""
    return cone_started_suddenly()._replace(title="the paper's cone, started steadily", static=True)


def steel_link() -> Scene:
    """A steel link let go from the horizontal."""
    rod = Rod(1.0, Uniform(0.01), young=2e11, density=7800.0)
    system = System(rod, Rotation(), Ritz(1), gravity=9.81)
    return Scene("a steel link swinging", system, system.state(), 1.0, FinalTip(), static=True)


def rotor_near_critical() -> Scene:
    """A rubber rotor driven at nine tenths of the spin at which it would give way."""
    young, density = 1e7, 1200.0
    rod = Rod(1.0, Uniform(0.025), young=young, density=density)
    rate = 0.9 * jnp.pi / 2 * jnp.sqrt(young / density)
    system = System(rod, steady(rate), Ritz(1))
    return Scene("a rotor near the critical spin", system, system.state(), 0.5, LargestStrain())


def tether() -> Scene:
    """A light tether with ten times its mass at the tip."""
    rod = Rod(10.0, Uniform(0.005), young=5e9, density=1000.0, tip_mass=7.85)
    system = System(rod, Rotation(), Ritz(1), gravity=9.81)
    return Scene("a tether with tip mass", system, system.state(rate=0.5), 2.0, FinalTip())


def impact() -> Scene:
    """A rod struck at the tip, by a half-sine that ends before its wave is at the root; how far is the root stretched?

    By twice the blow, F / EA = 1 %: a fixed end reflects a wave as it comes.
    """
    young, density, radius = 1e7, 1200.0, 0.025
    rod = Rod(1.0, Uniform(radius), young=young, density=density)
    along = jnp.sqrt(density / young)  # s, that a wave takes
    peak = 0.01 * young * jnp.pi * radius**2
    system = System(rod, Rotation(), Ritz(1), forces=[TipForce(Partial(_blow, peak, 0.72 * along))])
    return Scene("impact at the tip", system, system.state(), float(4 * along), LargestStrain(at=0.0))


def past_the_pole() -> Scene:
    """A swing in space that passes just beside the vertical."""
    rod = Rod(1.0, Cone(0.02, 0.03), young=1e7, density=1200.0)
    system = System(rod, Spherical(), Ritz(1), gravity=9.81)
    start = system.state(angle=-1.4, rate=9.0, azimuth_rate=0.05)
    return Scene("a spherical swing past the pole", system, start, 1.0, FinalTip())


def steady(rate: Any) -> Driven:
    """Driven at a steady rate (rad/s), which is a leaf: it may be traced."""
    return Driven(Partial(_turned, validation.number("rate", rate, unit="rad/s")))


def _turned(rate, t):
    return rate * t


def _blow(peak, duration, t, state):
    del state
    return peak * jnp.sin(jnp.pi * jnp.clip(t / duration, 0.0, 1.0))


NAMED = {
    scene.__name__.replace("_", "-"): scene
    for scene in (
        cone_started_suddenly, cone_started_steadily, steel_link, rotor_near_critical, tether, impact, past_the_pole,
    )
}  # fmt: skip
