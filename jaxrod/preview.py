"""A look at the functions of time in a scene before it runs: where they change, so that no step passes over it.

They are evaluated along the start at 4,097 instants from begin to end, and at the knots of each `Record` and `Impulse`.
Their *activity* is how much they have changed until then, each over its largest size.  Times that share it out evenly are
where steps are to end: a short pulse gets most of them, wherever it is.  What lies between two instants is not seen.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .lagrangian import Lagrangian
from .lanes import depends_on_first
from .motion import Placement, State
from .signal import signals
from .system import System

INSTANTS = 4097
_KNOTS = 32
_SHARE = 0.3  # of its largest size, by which a load may change in a step: 13 steps for a period of a sine
_COMES_AND_GOES = 1.5  # activity within one step that hides a pulse in it


class Preview(eqx.Module):
    """What was seen: the instants (T,) in s, the activity until each, the most by which loads change the rate at which the
    rod turns (rad/s), and whether a function of time may have been missed."""

    instants: Float[Array, " T"]
    activity: Float[Array, " T"]
    gained: Float[Array, ""]
    unseen: Bool[Array, ""]

    @property
    def knots(self) -> Float[Array, " K"]:
        """Times in s between which the activity is alike."""
        ramp = jnp.linspace(0.0, 1e-6, self.instants.size, dtype=self.activity.dtype)
        rising = self.activity + ramp * jnp.maximum(self.activity[-1], 1e-6)
        shares = jnp.linspace(0.0, 1.0, _KNOTS + 1, dtype=rising.dtype) * rising[-1]
        return jnp.interp(shares, rising, self.instants)

    def steps(self, begin: Float[Array, "*any"], end: Float[Array, "*any"]) -> Float[Array, "*any"]:
        """How many steps resolve what changes between two times."""
        return self._between(begin, end) / _SHARE

    def hides_in(self, h: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a load comes and goes within a step of h s."""
        ends = jnp.minimum(self.instants + h, self.instants[-1])
        return jnp.max(self._between(self.instants, ends)) > _COMES_AND_GOES

    def _between(self, begin, end):
        return jnp.interp(end, self.instants, self.activity) - jnp.interp(begin, self.instants, self.activity)


def preview(system: System | Lagrangian, start: Any, t0, t1, knots: Float[Array, " K"] | None) -> Preview | None:
    """The look at a run from `start`; None where no load depends on time."""
    loads = _loads(system, start)
    if not loads:
        return None
    even = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, INSTANTS, dtype=t0.dtype)
    instants = even if knots is None else jnp.sort(jnp.concatenate([even, jnp.clip(knots, t0, t1)]))
    pushes = [jnp.nan_to_num(jax.vmap(load)(instants)) for load in loads]
    activity = sum(map(_activity, pushes), jnp.zeros_like(instants))
    gained, unseen = jnp.zeros_like(t0), jnp.asarray(False)
    if isinstance(system, System):
        if not system.motion.prescribed:
            gained = _gained(system, start, instants, pushes)
        unseen = system.motion.unseen(even)
        for force in system.forces:
            unseen = unseen | force.unseen(even, start)
    return jax.lax.stop_gradient(Preview(instants, activity, gained, unseen))


def _loads(system: System | Lagrangian, start: Any) -> list[Callable]:
    """What drives the scene, as functions of time at its start: generalized forces, those of the director first."""
    if isinstance(system, Lagrangian):
        autonomous = not depends_on_first(system.acceleration, jnp.zeros((), start[0].dtype), *start)
        return [] if autonomous else [lambda t: system.acceleration(t, *start)]
    if system.motion.prescribed:
        return [
            lambda t: system.motion.turning(t)[1][None] ** 2,
            *(_pushed(force, system, start) for force in system.forces),
        ]
    return [_pushed(force, system, start) for force in system.forces if force.varies or signals(force)]


def _pushed(force, system: System, start: State) -> Callable:
    body = system.body
    virtual = jax.tree.map(jnp.zeros_like, Placement(start.direction, start.amplitudes, start.center))

    def pushed(t):
        found = jax.grad(lambda virtual: force.power(t, start, virtual, body))(virtual)
        return jnp.concatenate([x.reshape(-1) for x in jax.tree.leaves(found)])

    return pushed


def _activity(pushed: Float[Array, "T m"]) -> Float[Array, " T"]:
    changes = jnp.sum(jnp.abs(jnp.diff(pushed, axis=0)), axis=1)
    largest = jnp.max(jnp.sum(jnp.abs(pushed), axis=1))
    return jnp.concatenate([jnp.zeros_like(largest)[None], jnp.cumsum(changes)]) / jnp.where(largest > 0, largest, 1.0)


def _gained(system: System, start: State, instants, pushes: list) -> Float[Array, ""]:
    """By the impulses of the loads about the pivot, over the moment of inertia."""
    moment = sum(pushed[:, : start.direction.size] for pushed in pushes)
    moment = moment - (moment @ start.direction)[:, None] * start.direction[None, :]
    steps = jnp.diff(instants)[:, None] * (moment[1:] + moment[:-1]) / 2
    return jnp.max(jnp.linalg.norm(jnp.cumsum(steps, axis=0), axis=1)) / system.body.mass_matrix[0, 0]
