"""How the rod is held.

Axes: in the plane x is horizontal and y up; in space x and y are horizontal and z up.  The director d is the unit
vector along the rod from root to tip; angles are measured above the horizontal.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import calling, tracing, units, validation
from ..core.units import Number
from .signal import AbstractSignal, at_each, beyond, kinked, on_clock, signals, twice


class AbstractMotion(eqx.Module):
    """How a rod is held: the facts from which coordinates, splittings and starts are chosen.

    A motion of your own is a subclass with a `dimension`, a `pivot`, and what else differs from these:

    - `dimension`: of the space the director lives in, 2 or 3 (in space the vertical is a pole of the angles);
    - `prescribed`: whether the rotation is given, by `turning`, and the strain alone moves;
    - `flies`: whether no point is held: the centre of mass decouples, and gravity acts on it alone;
    - `pivot`: the point that is held, in m from the root; None where it is the root itself, and in flight;
    - `pull`: what gravity is in it, as a vector in the axes of the director.

    tests/motions/test_own_motion.py has two of one's own.
    """

    dimension: ClassVar[int]
    prescribed: ClassVar[bool] = False
    flies: ClassVar[bool] = False
    pivot: eqx.AbstractVar[Float[Array, ""] | None]

    def turning(self, t: Any) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """Angle (rad), rate and acceleration at time t of a rotation that is prescribed.

        **Raises:** `ValueError` for any other.
        """
        raise ValueError(f"motion={type(self).__name__}() has no drive; take Driven(angle).")

    def largest_rate(self, times: Float[Array, " T"]) -> Float[Array, ""]:
        """The fastest that the rod is driven, in rad/s, at any of these times, where its rotation is prescribed."""
        return jnp.max(jnp.abs(jax.vmap(self.turning)(times)[1]))

    def pull(self, gravity: Float[Array, ""] | Float[Array, " D"]) -> Float[Array, " D"]:
        """The acceleration of gravity in m/s^2 as a vector: given as one, or as a number, downwards."""
        if gravity.ndim == 1:
            return gravity
        return jnp.zeros(self.dimension, gravity.dtype).at[-1].set(-gravity)

    def __repr__(self):
        in_units = {name: "m" if name == "pivot" else "" for name in vars(self)}
        return validation.written(self, **in_units)

    def unknown(self, t0: Float[Array, ""], t1: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a `Record` of what is prescribed does not reach over a run from t0 to t1 (s)."""
        return beyond(signals(self), t0, t1, may_end=False)

    def unseen(self, times: Float[Array, " T"]) -> Bool[Array, ""]:
        """Whether what is prescribed moves, though at none of these instants it is seen to be accelerated."""
        if not self.prescribed or signals(self):
            return jnp.asarray(False)
        angle, _, acceleration = at_each(self.turning, times)
        return kinked(angle, acceleration, times)

    def delayed(self, t0: Float[Array, ""]) -> "AbstractMotion":
        """The same motion on a clock that shows zero at t0 (s)."""
        return _Later(self, t0) if self.prescribed else self


class Rotation(AbstractMotion):
    """Turning about a fixed horizontal axis through the rod: equation (4).

    **Arguments:** `pivot`, distance of the axis from the root in m (0: the rod hangs on its root).
    """

    pivot: Any
    dimension: ClassVar[int] = 2

    def __init__(self, pivot: Number | None = 0.0):
        self.pivot = _inside(pivot)


class Spherical(AbstractMotion):
    """Turning in space about a fixed point of the rod: equation (8).

    **Arguments:** `pivot`, distance of the fixed point from the root in m.
    """

    pivot: Any
    dimension: ClassVar[int] = 3

    def __init__(self, pivot: Number | None = 0.0):
        self.pivot = _inside(pivot)


class Driven(AbstractMotion):
    """Turning about a fixed horizontal axis as a motor prescribes it; the strain is the only motion left.

    **Arguments:** `angle`, a function of time t (s) that gives the angle above the horizontal in rad, twice
    differentiable (numbers in an Equinox module are differentiable), or a `Record` of it; `pivot`, distance of the axis
    from the root in m.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Driven(lambda t: 15.0 * t))
    >>> sol = jaxrod.simulate(system, system.state(), t1=0.1)
    >>> print(f"{sol.strain[-1]:.6f}, {system.drive_torque(0.1, sol.states[-1]):.4f} N m")
    0.018159, -1.1011 N m
    """

    angle: Any
    pivot: Any
    dimension: ClassVar[int] = 2
    prescribed: ClassVar[bool] = True

    def __init__(self, angle: Callable[..., Any], pivot: Number | None = 0.0):
        if not callable(angle):
            raise ValueError(
                f"Driven(angle={validation.given(angle)}) is not a function of time; give one, such as lambda t: 15.0 * t."
            )
        calling.tried("Driven(angle=)", "t (s) -> angle in rad", angle, calling.like(), shapes=[()])
        if isinstance(angle, AbstractSignal):
            angle.fits("Driven(angle=)", "rad")
        self.angle = tracing.carried(angle)
        self.pivot = _inside(pivot)

    def turning(self, t: Any):
        return twice(self.angle, jnp.asarray(t) * 1.0)

    def delayed(self, t0: Float[Array, ""]):
        return Driven(_Delayed(self.angle, t0), self.pivot)


class _Delayed(eqx.Module):
    """An angle on a clock that shows zero at t0."""

    angle: Any
    t0: Float[Array, ""]

    def __call__(self, t):
        return on_clock(lambda t: jnp.asarray(self.angle(t), t.dtype), self.t0, t)


class _Later(AbstractMotion):
    """A prescribed motion on a clock that shows zero at t0."""

    motion: AbstractMotion
    t0: Float[Array, ""]
    prescribed: ClassVar[bool] = True

    def __init__(self, motion: AbstractMotion, t0: Float[Array, ""]):
        self.motion, self.t0 = motion, t0

    @property
    def dimension(self) -> int:
        return self.motion.dimension

    @property
    def pivot(self):
        return self.motion.pivot

    def turning(self, t: Any):
        angle, rate, acceleration = on_clock(lambda t: jnp.stack(self.motion.turning(t)), self.t0, jnp.asarray(t) * 1.0)
        return angle, rate, acceleration

    def pull(self, gravity: Float[Array, ""] | Float[Array, " D"]):
        return self.motion.pull(gravity)


class Flight(AbstractMotion):
    """Free motion in a vertical plane: equation (6).  The centre of mass decouples; gravity acts on it alone."""

    dimension: ClassVar[int] = 2
    flies: ClassVar[bool] = True

    def __init__(self):
        pass

    @property
    def pivot(self) -> None:
        return None


def _inside(pivot):
    """A pivot, or None if it is known to be the root: then the rod is one piece."""
    if pivot is None:
        return None
    place = validation.not_negative("pivot", pivot, "m", "metres from the root")
    given = units.in_unit("pivot", pivot, "m")  # under jit even a known number is traced, once it is an array
    return None if tracing.known(given) and not np.any(np.asarray(given)) else place
