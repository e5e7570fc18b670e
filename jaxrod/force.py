"""Forces without a potential, each given by its virtual power.

A force is a function P(t, state, virtual), linear in the virtual velocity; the generalized forces are its derivative
by the generalized velocities, whatever the coordinates.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from . import checks
from .motion import AbstractMotion, Flight, Placement, State


class AbstractForce(eqx.Module):
    """A force without a potential."""

    @abc.abstractmethod
    def power(self, t, state: State, virtual: Placement) -> Float[Array, ""]:
        """Power in W of the force at time t and `state` in the virtual velocity `virtual`."""

    @abc.abstractmethod
    def check(self, motion: AbstractMotion) -> None:
        """Refuse, by `ValueError`, a motion this force cannot act on."""


class Torque(AbstractForce):
    """A constant moment on the rod: P = tau . (d x d').

    **Arguments:** `moment` in N m: one number in the plane (positive raises the angle), three in space.
    """

    moment: Float[Array, ""] | Float[Array, " 3"]

    def __init__(self, moment):
        self.moment = checks.number("Torque(moment=)", moment, (3,) if jnp.ndim(moment) else ())

    def power(self, t, state, virtual):
        del t
        d, rate = state.direction, virtual.direction
        if state.planar:
            return self.moment * (d[0] * rate[1] - d[1] * rate[0])
        return self.moment @ jnp.cross(d, rate)

    def check(self, motion):
        if (motion.dimension == 3) != (self.moment.ndim == 1):
            needed = "three numbers in space" if motion.dimension == 3 else "one number in the plane"
            raise ValueError(f"Torque(moment={checks.shown(self.moment)}) does not fit the motion; give {needed}.")


class PivotFriction(AbstractForce):
    """Viscous friction of the pivot, a moment against the turning rate: P = -c omega . omega_virtual.

    **Arguments:** `coefficient` c in N m s, not negative.
    """

    coefficient: Float[Array, ""]

    def __init__(self, coefficient):
        self.coefficient = checks.not_negative("PivotFriction(coefficient=)", coefficient, "N m s")

    def power(self, t, state, virtual):
        del t
        return -self.coefficient * (state.direction_rate @ virtual.direction)

    def check(self, motion):
        if isinstance(motion, Flight):
            raise ValueError("PivotFriction needs a pivot and Flight() has none; take Rotation() or leave it out.")
