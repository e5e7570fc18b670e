"""Forces without a potential, each given by its virtual power.

A force is a function P(t, state, virtual, body), linear in the virtual velocity; the generalized forces are its
derivative by the generalized velocities, whatever the coordinates and the strain shapes.  Its strength is a number or a
function (t, state) -> number; numbers in an Equinox module are differentiable.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import checks
from .motion import AbstractMotion, AbstractPivoted, Placement, State
from .projection import Projection


class AbstractForce(eqx.Module):
    """A force without a potential."""

    @abc.abstractmethod
    def power(self, t, state: State, virtual: Placement, body: Projection) -> Float[Array, ""]:
        """Power in W of the force at time t and `state` in the virtual velocity `virtual` of the rod `body`."""

    @abc.abstractmethod
    def check(self, motion: AbstractMotion) -> None:
        """Refuse, by `ValueError`, a motion this force cannot act on."""


class Torque(AbstractForce):
    """A moment on the rod: P = tau . (d x d').

    **Arguments:** `moment` in N m: one number in the plane (positive raises the angle), three in space; or a function
    (t, state) of them.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> motor = jaxrod.Torque(lambda t, state: 2.0 * jnp.sin(3 * t) - 0.1 * state.rate)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), forces=[motor])
    >>> print(jaxrod.simulate(system, system.state(), t1=1.0).angle.round(4))
    [0.7795]
    """

    moment: Any

    def __init__(self, moment):
        self.moment = _strength("Torque(moment=)", moment, (3,) if np.ndim(_number(moment)) else ())

    def power(self, t, state, virtual, body):
        del body
        d, rate, moment = state.direction, virtual.direction, _at(self.moment, t, state)
        if state.planar:
            return moment * (d[0] * rate[1] - d[1] * rate[0])
        return moment @ jnp.cross(d, rate)

    def check(self, motion):
        if not callable(self.moment) and (motion.dimension == 3) != (self.moment.ndim == 1):
            needed = "three numbers in space" if motion.dimension == 3 else "one number in the plane"
            raise ValueError(f"Torque(moment={checks.shown(self.moment)}) does not fit the motion; give {needed}.")


class TipForce(AbstractForce):
    """A force on the tip: P = F . v_tip.

    **Arguments:** `force` in N: one number pulls along the rod, wherever it points; as many as the space has dimensions
    keep their direction in space; or a function (t, state) of either.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), forces=[jaxrod.TipForce(196.35)])
    >>> print(jaxrod.equilibrium(system).strain.round(5))
    0.01
    """

    force: Any

    def __init__(self, force):
        self.force = _strength("TipForce(force=)", force, np.shape(_number(force)))

    def power(self, t, state, virtual, body):
        force = _at(self.force, t, state)
        lengthening = body.tip[1:] @ virtual.amplitudes
        if jnp.ndim(force) == 0:
            flying = 0.0 if virtual.center is None else state.direction @ virtual.center
            return force * (lengthening + flying)
        velocity = lengthening * state.direction + body.reach(state.amplitudes) * virtual.direction
        return force @ (velocity if virtual.center is None else velocity + virtual.center)

    def check(self, motion):
        if not callable(self.force) and self.force.shape not in ((), (motion.dimension,)):
            raise ValueError(
                f"TipForce(force={checks.shown(self.force)}) does not fit the motion; give one number along the rod or "
                f"{motion.dimension} in space."
            )


class PivotFriction(AbstractForce):
    """Viscous friction of the pivot, a moment against the turning rate: P = -c omega . omega_virtual.

    **Arguments:** `coefficient` c in N m s, not negative; or a function (t, state) of it.
    """

    coefficient: Any

    def __init__(self, coefficient):
        self.coefficient = _damping("PivotFriction(coefficient=)", coefficient, "N m s")

    def power(self, t, state, virtual, body):
        del body
        return -_at(self.coefficient, t, state) * (state.direction_rate @ virtual.direction)

    def check(self, motion):
        _check_pivot(self, motion)


class KelvinVoigt(AbstractForce):
    """Viscosity of the material, stress E (strain + time strain'): P = -time a'^T K a'_virtual.

    **Arguments:** `time` in s, viscosity over Young's modulus (the retardation time), not negative; or a function
    (t, state) of it.  Axial vibration at the angular frequency omega decays at the rate time omega^2 / 2.
    """

    time: Any

    def __init__(self, time):
        self.time = _damping("KelvinVoigt(time=)", time, "seconds")

    def power(self, t, state, virtual, body):
        return -_at(self.time, t, state) * (state.amplitude_rates @ body.stiffness_matrix @ virtual.amplitudes)

    def check(self, motion):
        del motion


class ShakenBase(AbstractForce):
    """The pivot moves: inertia of the rod against the acceleration of its base, P = -R'' . d/dt(first moment).

    All positions, velocities and energies of the scene are then relative to the moving pivot.

    **Arguments:** `position`, a function of t (s) that gives the place R of the pivot in m (D,), twice differentiable.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e9, density=1200.0)
    >>> shaker = jaxrod.ShakenBase(lambda t: jnp.stack([0.0 * t, 0.02 * jnp.cos(300 * t)]))
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81, forces=[shaker])
    >>> sol = jaxrod.simulate(system, system.state(angle=1.4), ts=jnp.linspace(0.01, 2.0, 200))
    >>> print(bool(sol.angle.min() > 1.3))  # Kapitza's pendulum stands upright
    True
    """

    position: Any

    def __init__(self, position):
        if not callable(position):
            raise ValueError(f"ShakenBase(position={position!r}) is not a function of time; give one, t -> (D,) in m.")
        self.position = checks.carried(position)

    def power(self, t, state, virtual, body):
        def velocity(t):
            return jax.jvp(self.position, (t,), (jnp.ones_like(t),))[1]

        t = jnp.asarray(t, state.direction.dtype)
        _, acceleration = jax.jvp(velocity, (t,), (jnp.ones_like(t),))
        lengthening = body.first_moments[1:] @ virtual.amplitudes
        moving = lengthening * state.direction + body.moment(state.amplitudes) * virtual.direction
        return -acceleration @ moving

    def check(self, motion):
        _check_pivot(self, motion)
        shape = getattr(jax.eval_shape(self.position, jnp.zeros(())), "shape", "no array")
        if shape != (motion.dimension,):
            raise ValueError(
                f"ShakenBase(position=) gives {shape}; it must give the place of the pivot, "
                f"({motion.dimension},) numbers in m."
            )


def _strength(name: str, value: Any, shape: tuple[int, ...]) -> Any:
    return checks.carried(value) if callable(value) else checks.number(name, value, shape)


def _damping(name: str, value: Any, unit: str) -> Any:
    return checks.carried(value) if callable(value) else checks.not_negative(name, value, unit)


def _number(value: Any) -> Any:
    return 0.0 if callable(value) else value


def _at(strength: Any, t, state: State) -> Any:
    return strength(t, state) if callable(strength) else strength


def _check_pivot(force: AbstractForce, motion: AbstractMotion) -> None:
    if not isinstance(motion, AbstractPivoted):
        raise ValueError(
            f"{type(force).__name__} needs a pivot and {type(motion).__name__}() has none; take Rotation() or leave it out."
        )
