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
from .signal import at_each, signals
from .system import System

INSTANTS = 4097
_PARTS = 16  # of the activity, between which steps end
_SHARE = 0.1  # of its largest size, by which a load may change in a step: 40 steps for a period of a sine
_COMES_AND_GOES = 1.5  # activity within one step that hides a pulse in it


class Preview(eqx.Module):
    """What was seen: the instants (T,) in s, the activity of bare functions until each, the most by which loads change the
    rate at which the rod turns (rad/s), and whether a function of time may have been missed."""

    instants: Float[Array, " T"]
    activity: Float[Array, " T"]
    gained: Float[Array, ""]
    unseen: Bool[Array, ""]

    @property
    def knots(self) -> Float[Array, " K"]:
        """Instants about the times that part the activity evenly, its begin and its end among them."""
        shares = jnp.linspace(0.0, 1.0, _PARTS + 1, dtype=self.activity.dtype).at[0].set(1e-9).at[-1].set(1 - 1e-9)
        after = jnp.searchsorted(self.activity, shares * self.activity[-1])
        return self.instants[jnp.concatenate([jnp.maximum(after - 1, 0), jnp.minimum(after, self.instants.size - 1)])]

    def steps(self, ends: Float[Array, " E"]) -> Float[Array, " E"]:
        """How many steps to each of these times, from the one before, resolve what changes fastest between the two."""
        begins = jnp.concatenate([self.instants[:1], ends[:-1]])
        length = jnp.diff(self.instants)
        pace = jnp.where(length > 0, jnp.diff(self.activity) / jnp.where(length > 0, length, 1.0), 0.0)
        there = jnp.clip(jnp.searchsorted(self.instants, begins, side="right") - 1, 0, pace.size - 1)
        leg = jnp.clip(jnp.searchsorted(ends, self.instants[:-1], side="right"), 0, ends.size - 1)
        fastest = pace[there].at[leg].max(pace)
        return fastest * (ends - begins) / _SHARE

    @property
    def mean_steps(self) -> Float[Array, ""]:
        """How many steps resolve the whole run, were it to change alike all the time."""
        return self.activity[-1] / _SHARE

    def hides_in(self, h: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a load comes and goes within a step of h s."""
        later = jnp.interp(self.instants + h, self.instants, self.activity)
        return jnp.max(later - self.activity) > _COMES_AND_GOES


def preview(system: System | Lagrangian, start: Any, t0, t1, knots: Float[Array, " K"] | None) -> Preview | None:
    """The look at a run from `start`; None where no load depends on time."""
    loads = _loads(system, start)
    if not loads:
        return None
    even = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, INSTANTS, dtype=t0.dtype)
    instants = even if knots is None else jnp.sort(jnp.concatenate([even, jnp.clip(knots, t0, t1)]))
    pushes = [jnp.nan_to_num(at_each(load, instants)) for _, load in loads]
    bare = [pushed for (varies, _), pushed in zip(loads, pushes, strict=True) if varies]
    activity = sum(map(_activity, bare), jnp.zeros_like(instants))
    gained, unseen = jnp.zeros_like(t0), jnp.asarray(False)
    if isinstance(system, System):
        if not system.motion.prescribed:
            gained = _gained(system, start, instants, pushes)
        unseen = system.motion.unseen(even)
        for force in system.forces:
            unseen = unseen | force.unseen(even, start)
    return jax.lax.stop_gradient(Preview(instants, activity, gained, unseen))


def _loads(system: System | Lagrangian, start: Any) -> list[tuple[bool, Callable]]:
    """What drives the scene, as functions of time at its start: generalized forces, those of the director first.

    With each whether it is bare: nothing else says where it changes.
    """
    if isinstance(system, Lagrangian):
        autonomous = not depends_on_first(system.acceleration, jnp.zeros((), start[0].dtype), *start)
        return [] if autonomous else [(True, lambda t: system.acceleration(t, *start))]
    motion: Any = system.motion
    drives = [(True, lambda t: motion.turning(t)[1][None] ** 2)] if motion.prescribed else []
    timed = [force for force in system.forces if force.varies or signals(force)]
    return [*drives, *((force.varies, _pushed(force, system, start)) for force in timed)]


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
