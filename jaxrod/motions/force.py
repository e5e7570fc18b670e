"""Forces without a potential, each given by its virtual power.

A force is a function P(t, state, virtual, body), linear in the virtual velocity; the generalized forces are its
derivative by the generalized velocities, whatever the coordinates and the strain shapes.  Its strength is a number, a
function (t, state) -> number, a `Record` or an `Impulse`; numbers in an Equinox module are differentiable.  Hold what
varies from run to run in such a module: a lambda is another program each time it is written, and compiles anew.

Before a run a function is looked at along the start, at 4,097 instants between its begin and its end: steps resolve what
is seen there.  What is shorter than (t1 - t0) / 4096 may fall between two of them; give it as `Record` or `Impulse`.
"""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import calling, tracing, units, validation
from ..core.tracing import depends_on_first
from ..core.units import Number, Row
from ..shapes.projection import Projection
from .motion import AbstractMotion
from .signal import AbstractSignal, at_each, beyond, kinked, on_clock, signals, twice
from .state import Placement, State

_BESIDE = 0.1  # of every number of a state: one that is at rest nowhere


class AbstractForce(eqx.Module):
    """A force without a potential."""

    @abc.abstractmethod
    def power(self, t: Any, state: State, virtual: Placement, body: Projection) -> Float[Array, ""]:
        """Power in W of the force at time t and `state` in the virtual velocity `virtual` of the rod `body`."""

    @abc.abstractmethod
    def check(self, motion: AbstractMotion) -> None:
        """Refuse, by `ValueError`, a motion this force cannot act on."""

    def try_out(self, t: Any, state: State, power: Callable[[], None]) -> None:
        """Refuse, by `ValueError`, a function in this force that fails for examples of time and state.

        `power` tries the power as a whole, as is right for a force that is not one of this library.
        """
        del t, state
        power()

    def __repr__(self):
        return validation.written(self, **dict.fromkeys(vars(self), ""))

    @property
    def varies(self) -> bool:
        """Whether it has to be looked at, as it may depend on time in a way that nothing tells the stepper."""
        return True

    def unknown(self, t0: Float[Array, ""], t1: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a `Record` in it does not reach over a run from t0 to t1 (s)."""
        return beyond(signals(self), t0, t1, may_end=True)

    def pushed(self, t: Float[Array, ""], state: State, body: Projection) -> Float[Array, " N"]:
        """Its generalized forces: derivative of the power by the virtual velocity, the director's first."""
        virtual = jax.tree.map(jnp.zeros_like, Placement(state.direction, state.amplitudes, state.center))
        found = jax.grad(lambda virtual: self.power(t, state, virtual, body))(virtual)
        return jnp.concatenate([x.reshape(-1) for x in jax.tree.leaves(found)])

    def unseen(self, times: Float[Array, " T"], state: State, body: Projection) -> Bool[Array, ""]:
        """Whether it is a function of time that does nothing at any of these instants, as a short pulse between them."""
        if not self.varies or signals(self):
            return jnp.asarray(False)
        return _never(lambda t, state: self.pushed(t, state, body), times, state)

    def delayed(self, t0: Float[Array, ""]) -> "AbstractForce":
        """The same force on a clock that shows zero at t0 (s)."""
        return _Delayed(self, t0)


class _Delayed(AbstractForce):
    """A force on a clock that shows zero at t0."""

    force: AbstractForce
    t0: Float[Array, ""]

    def power(self, t, state, virtual, body):
        return on_clock(lambda t: self.force.power(t, state, virtual, body), self.t0, t)

    def check(self, motion):
        self.force.check(motion)

    def try_out(self, t, state, power):
        del t, state, power  # tried when the scene was built

    @property
    def varies(self):
        return self.force.varies

    def unseen(self, times, state, body):
        return self.force.unseen(self.t0 + times, state, body)


class AbstractStrength(AbstractForce):
    """A force of one `strength`: a number, or a function (t, state) of it."""

    @property
    @abc.abstractmethod
    def strength(self) -> Any:
        """The number or the function."""

    @property
    def varies(self):
        return _is_looked_at(self.strength)

    def unseen(self, times: Float[Array, " T"], state: State, body: Projection):
        del body
        if not callable(self.strength) or signals(self.strength):
            return jnp.asarray(False)
        return _never(self.strength, times, state)


class Torque(AbstractStrength):
    """A moment on the rod: P = tau . (d x d').

    **Arguments:** `moment` in N m: one number in the plane (positive raises the angle), three in space; or a function
    (t, state) of them, a `Record` or an `Impulse`.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> motor = jaxrod.Torque(lambda t, state: 2.0 * jnp.sin(3 * t) - 0.1 * state.rate)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), forces=[motor])
    >>> print(jaxrod.simulate(system, system.state(), t1=1.0).angle.round(4))
    [0.7795]

    A run is compiled for each function anew, so a loop over loads holds their numbers in a module instead of a lambda.  Its
    runs after the first start at once:

    >>> import equinox as eqx
    >>> class Sine(eqx.Module):
    ...     most: float
    ...     def __call__(self, t, state):
    ...         return self.most * jnp.sin(3 * t)
    >>> for most in (1.0, 2.0):
    ...     system = jaxrod.System(rod, jaxrod.Rotation(), forces=[jaxrod.Torque(Sine(jnp.asarray(most)))])
    ...     print(jaxrod.simulate(system, system.state(), t1=0.5).angle.round(4))
    [0.0711]
    [0.1422]
    """

    moment: Any

    def __init__(self, moment: Number | Row | Callable[..., Any]):
        moment = units.in_unit("Torque(moment=)", moment, "N m")
        self.moment = _strength("Torque(moment=)", moment, (3,) if np.ndim(_number(moment)) else (), "N m")

    @property
    def strength(self):
        return self.moment

    def power(self, t: Any, state: State, virtual: Placement, body: Projection):
        del body
        d, rate, moment = state.direction, virtual.direction, _at(self.moment, t, state)
        if state.planar:
            return moment * (d[0] * rate[1] - d[1] * rate[0])
        return moment @ jnp.cross(d, rate)

    def check(self, motion: AbstractMotion):
        if not callable(self.moment) and (motion.dimension == 3) != (self.moment.ndim == 1):
            needed = "three numbers in space" if motion.dimension == 3 else "one number in the plane"
            raise ValueError(f"Torque(moment={validation.shown(self.moment)}) does not fit the motion; give {needed}.")

    def try_out(self, t: Any, state: State, power: Callable[[], None]):
        del power
        wanted, shape = ("one number in N m", ()) if state.planar else ("three numbers in N m", (3,))
        _try_strength("Torque(moment=)", wanted, self.moment, t, state, [shape])


class TipForce(AbstractStrength):
    """A force on the tip: P = F . v_tip.

    **Arguments:** `force` in N: one number pulls along the rod, wherever it points; as many as the space has dimensions
    keep their direction in space; or a function (t, state) of either, a `Record` or an `Impulse`.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), forces=[jaxrod.TipForce(196.35)])
    >>> print(jaxrod.equilibrium(system).strain.round(5))
    0.01
    """

    force: Any

    def __init__(self, force: Number | Row | Callable[..., Any]):
        force = units.in_unit("TipForce(force=)", force, "N")
        self.force = _strength("TipForce(force=)", force, np.shape(_number(force))[:1], "N")

    @property
    def strength(self):
        return self.force

    def power(self, t: Any, state: State, virtual: Placement, body: Projection):
        force = _at(self.force, t, state)
        lengthening = body.tip[1:] @ virtual.amplitudes
        if jnp.ndim(force) == 0:
            flying = 0.0 if virtual.center is None else state.direction @ virtual.center
            return force * (lengthening + flying)
        velocity = lengthening * state.direction + body.reach(state.amplitudes) * virtual.direction
        return force @ (velocity if virtual.center is None else velocity + virtual.center)

    def check(self, motion: AbstractMotion):
        if not callable(self.force) and self.force.shape not in ((), (motion.dimension,)):
            raise ValueError(
                f"TipForce(force={validation.shown(self.force)}) does not fit the motion; give one number along the rod or "
                f"{motion.dimension} in space."
            )

    def try_out(self, t: Any, state: State, power: Callable[[], None]):
        del power
        shape = state.direction.shape
        wanted = f"one number in N along the rod, or {shape[0]} in space"
        _try_strength("TipForce(force=)", wanted, self.force, t, state, [(), shape])


class PivotFriction(AbstractStrength):
    """Viscous friction of the pivot, a moment against the turning rate: P = -c omega . omega_virtual.

    **Arguments:** `coefficient` c in N m s, not negative; or a function (t, state) of it.
    """

    coefficient: Any

    def __init__(self, coefficient: Number | Callable[..., Any]):
        self.coefficient = _damping("PivotFriction(coefficient=)", coefficient, "N m s")

    @property
    def strength(self):
        return self.coefficient

    def power(self, t: Any, state: State, virtual: Placement, body: Projection):
        del body
        return -_at(self.coefficient, t, state) * (state.direction_rate @ virtual.direction)

    def check(self, motion: AbstractMotion):
        _check_pivot(self, motion)

    def try_out(self, t: Any, state: State, power: Callable[[], None]):
        del power
        _try_damping("PivotFriction(coefficient=)", "N m s", self.coefficient, t, state)


class KelvinVoigt(AbstractStrength):
    """Viscosity of the material, stress E (strain + time strain'): P = -time a'^T K a'_virtual.

    **Arguments:** `time` in s, viscosity over Young's modulus (the retardation time), not negative; or a function
    (t, state) of it.  Axial vibration at the angular frequency omega decays at the rate time omega^2 / 2.
    """

    time: Any

    def __init__(self, time: Number | Callable[..., Any]):
        self.time = _damping("KelvinVoigt(time=)", time, "s", "seconds")

    @property
    def strength(self):
        return self.time

    def power(self, t: Any, state: State, virtual: Placement, body: Projection):
        return -_at(self.time, t, state) * (state.amplitude_rates @ body.stiffness_matrix @ virtual.amplitudes)

    def check(self, motion: AbstractMotion):
        del motion

    def try_out(self, t: Any, state: State, power: Callable[[], None]):
        del power
        _try_damping("KelvinVoigt(time=)", "seconds", self.time, t, state)


class ShakenBase(AbstractForce):
    """The pivot moves: inertia of the rod against the acceleration of its base, P = -R'' . d/dt(first moment).

    All positions, velocities and energies of the scene are then relative to the moving pivot.

    **Arguments:** `position`, the place R of the pivot in m (D,), or `acceleration`, R'' in m/s^2 (D,): a function of t
    (s) or a `Record`.  A position is differentiated twice: one that jumps, or whose rate does, is not seen to, but as a
    `Record`.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e9, density=1200.0)
    >>> shaker = jaxrod.ShakenBase(lambda t: jnp.stack([0.0 * t, 0.02 * jnp.cos(300 * t)]))
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81, forces=[shaker])
    >>> sol = jaxrod.simulate(system, system.state(angle=1.4), ts=jnp.linspace(0.01, 2.0, 200))
    >>> print(bool(sol.angle.min() > 1.3))  # Kapitza's pendulum stands upright
    True
    """

    position: Any
    acceleration: Any

    def __init__(self, position: Callable[..., Any] | None = None, *, acceleration: Callable[..., Any] | None = None):
        if (position is None) == (acceleration is None):
            given = "neither" if position is None else "both"
            raise ValueError(f"ShakenBase: {given} of position= and acceleration= given; give one of them.")
        for name, value in (("position", position), ("acceleration", acceleration)):
            if value is not None and not callable(value):
                raise ValueError(
                    f"ShakenBase({name}={validation.given(value)}) is not a function of time; give one, t -> (D,)."
                )
        self.position = None if position is None else _function("ShakenBase(position=)", position, "m")
        self.acceleration = (
            None if acceleration is None else _function("ShakenBase(acceleration=)", acceleration, "m/s^2")
        )

    def power(self, t: Any, state: State, virtual: Placement, body: Projection):
        t = jnp.asarray(t, state.direction.dtype)
        acceleration = self.moved(t)[2]
        lengthening = body.first_moments[1:] @ virtual.amplitudes
        moving = lengthening * state.direction + body.moment(state.amplitudes) * virtual.direction
        return -acceleration @ moving

    def moved(self, t: Any) -> tuple[Any, Any, Float[Array, " D"]]:
        """Position, velocity and acceleration of the base at time t; the first two None where only the last is given."""
        if self.acceleration is not None:
            return None, None, calling.real(self.acceleration(t))
        return twice(lambda t: calling.real(self.position(t)), t)

    def check(self, motion: AbstractMotion):
        _check_pivot(self, motion)
        name, given = ("position", self.position) if self.acceleration is None else ("acceleration", self.acceleration)
        what = "the place of the pivot in m" if name == "position" else "the pivot's acceleration in m/s^2"
        wanted = f"t (s) -> {what}, ({motion.dimension},)"
        calling.tried(f"ShakenBase({name}=)", wanted, given, calling.like(), shapes=[(motion.dimension,)])

    def try_out(self, t: Any, state: State, power: Callable[[], None]):
        del t, state, power  # its function was tried with the motion

    @property
    def varies(self):
        return _is_looked_at(self.position if self.acceleration is None else self.acceleration)

    def unknown(self, t0: Float[Array, ""], t1: Float[Array, ""]):
        return beyond(signals(self), t0, t1, may_end=self.position is None)

    def unseen(self, times: Float[Array, " T"], state: State, body: Projection):
        del state, body
        if signals(self):
            return jnp.asarray(False)
        place, rate, acceleration = at_each(self.moved, times)
        if place is None:
            return jnp.all(acceleration == 0)
        return kinked(place, acceleration, times) | (jnp.all(acceleration == 0) & jnp.all(rate == 0))


def _strength(name: str, value: Any, shape: tuple[int, ...], unit: str) -> Any:
    return _function(name, value, unit) if callable(value) else validation.number(name, value, shape, unit)


def _damping(name: str, value: Any, unit: str, what: str | None = None) -> Any:
    return _function(name, value, unit) if callable(value) else validation.not_negative(name, value, unit, what)


def _function(name: str, value: Any, unit: str) -> Any:
    if isinstance(value, AbstractSignal):
        value.fits(name, unit)
    return tracing.carried(value)


def _number(value: Any) -> Any:
    return 0.0 if callable(value) else value


def _at(strength: Any, t, state: State) -> Any:
    return calling.real(strength(t, state)) if callable(strength) else strength


def _try_strength(name: str, wanted: str, strength: Any, t, state: State, shapes: list[tuple[int, ...]]) -> None:
    if callable(strength):
        calling.tried(name, f"(t, state) -> {wanted}", strength, t, state, shapes=shapes)


def _try_damping(name: str, unit: str, strength: Any, t, state: State) -> None:
    wanted = f"one number in {unit}, not negative"
    _try_strength(name, wanted, strength, t, state, [()])
    if callable(strength):
        with jax.ensure_compile_time_eval():
            damping = strength(t, state)
        if validation.fails(lambda damping: damping >= 0, damping):
            raise ValueError(
                f"{name} returned {validation.shown(damping)} at t=0; give a function (t, state) -> {wanted}."
            )


def _is_looked_at(given: Any) -> bool:
    return callable(given) and not isinstance(given, AbstractSignal)


def _never(strength: Callable, times: Float[Array, " T"], state: State) -> Bool[Array, ""]:
    """Whether a function of time and state is zero at all these instants; if it reads the state, beside it too.

    At the start alone a damper is zero, and a force that grows with a strain.
    """

    def zero(state):
        return jnp.all(at_each(lambda t: strength(t, state), times) == 0)

    if not depends_on_first(lambda state, t: strength(t, state), state, times[0]):
        return zero(state)
    if not depends_on_first(strength, times[0], state):
        return jnp.asarray(False)
    return zero(state) & zero(jax.tree.map(lambda x: x + _BESIDE, state))


def _check_pivot(force: AbstractForce, motion: AbstractMotion) -> None:
    if motion.flies:
        raise ValueError(
            f"{type(force).__name__} needs a pivot and {type(motion).__name__}() has none; take Rotation() or leave it out."
        )
