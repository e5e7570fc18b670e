"""Whether the parts of a scene fit one another."""

import jax.numpy as jnp
import numpy as np

from . import checks
from .basis import AbstractBasis, QuasiStatic, Ritz
from .force import AbstractForce
from .motion import AbstractMotion, AbstractPivoted, Driven, Flight
from .rod import Lumped, Rod

_EXAMPLES = {"rod": "Rod(length, section, young, density)", "motion": "Rotation()", "basis": "Ritz(1)"}


def check_parts(rod, motion, basis, forces) -> None:
    """Refuse, by `ValueError`, what is no rod, motion, basis or force, and what has no meaning together."""
    for name, value, kind in (
        ("rod", rod, Rod | Lumped),
        ("motion", motion, AbstractMotion),
        ("basis", basis, AbstractBasis),
    ):
        if not isinstance(value, kind):
            raise ValueError(f"{name}={value!r} is not a {name}; give an instance such as {_EXAMPLES[name]}.")
    for force in forces:
        if not isinstance(force, AbstractForce):
            raise ValueError(f"forces holds {force!r}, which is not a force; give Torque, PivotFriction or your own.")
        force.check(motion)
    _check_support(rod, motion, basis)


def _check_support(rod, motion, basis):
    pivot = motion.pivot if isinstance(motion, AbstractPivoted) else None
    if isinstance(rod, Lumped):
        if isinstance(motion, Flight):
            raise ValueError("rod=Lumped(...) is a pivoted body without a mass; for Flight() give a Rod.")
        if pivot is not None:
            raise ValueError("rod=Lumped(...) is given about its pivot already; leave out pivot=.")
        if basis.n > 1 or not isinstance(basis, Ritz):
            raise ValueError(f"rod=Lumped(...) has one uniform strain; take Ritz(1) or Ritz(0), not {basis!r}.")
        return
    if misfit := basis.misfit(rod):
        raise ValueError(misfit)
    if isinstance(basis, QuasiStatic) and not rod.linear:
        raise ValueError(
            f"basis={basis!r} condenses Hooke's law only; leave out law= of the rod, or take {basis.basis!r}."
        )
    if isinstance(basis, QuasiStatic) and isinstance(motion, Driven):
        raise ValueError(
            f"basis={basis!r} leaves nothing to move where the rotation is Driven; take {basis.basis!r}, "
            "or jaxrod.equilibrium for the static strain."
        )
    if isinstance(motion, AbstractPivoted):
        pivot, length = jnp.zeros(()) if pivot is None else pivot, rod.length
        if checks.fails(np.less_equal, pivot, length):
            raise ValueError(
                f"pivot={checks.shown(pivot)} lies beyond the rod; it must be within length={checks.shown(length)} m."
            )
        if checks.fails(lambda area: area > 0, _area(rod, pivot)):
            raise ValueError(
                f"pivot={checks.shown(pivot)} m is where the section vanishes, and a pin at a point holds nothing; "
                "move the pivot or give the end a radius."
            )


@checks.at_once
def _area(rod: Rod, s):
    return rod.area(s)
