"""A look at the functions of time in a scene before it runs: where they change, so that no step passes over it.

They are evaluated along the start at 4,097 instants from begin to end, at the knots of each `Record` and `Impulse`, and
once more where they were seen to change.  The *activity* of one is how much it has changed until then, over its largest
size.  Times that share it out evenly are where steps are to end: a short pulse gets most of them, wherever it is.  What
lies between two instants is not seen.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .signal import at_each

INSTANTS = 4097
_CLOSER = 1024  # instants of the second look, at equal shares of the activity
_PARTS = 16  # of the activity of a function, between which steps end; less of each where they are several
_LEAST_PARTS = 4
_SHARE = 0.1  # of its largest size, by which a load may change in a step: 40 steps for a period of a sine
_COMES_AND_GOES = 1.5  # activity within one step that hides a pulse in it


class Preview(eqx.Module):
    """What was seen: the instants (T,) in s, the activity of bare functions until each; the same of the second look (C,);
    the instants (K,) at which steps are to end; the most by which loads change the rate at which the rod turns (rad/s); and
    whether a function of time may have been missed."""

    instants: Float[Array, " T"]
    activity: Float[Array, " T"]
    closer: Float[Array, " C"]
    closer_activity: Float[Array, " C"]
    knots: Float[Array, " K"]
    gained: Float[Array, ""]
    unseen: Bool[Array, ""]

    @staticmethod
    def of(scene: Any, start: Any, t0, t1, knots: Float[Array, " K"] | None) -> "Preview | None":
        """The look at a run from `start`; None where no load depends on time.

        `scene` says its `loads`, what they have `gained` and whether any is `unseen`: a `DiscreteSystem`, a `Lagrangian`.
        """
        loads = scene.loads(start)
        if not loads:
            return None
        even = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, INSTANTS, dtype=t0.dtype)
        instants = even if knots is None else jnp.sort(jnp.concatenate([even, jnp.clip(knots, t0, t1)]))
        pushes = [_pushes(load, instants) for _, load in loads]
        changes = [_activity(pushed) for (varies, _), pushed in zip(loads, pushes, strict=True) if varies]
        closer = _where_they_change(instants, changes)
        close = [_activity(_pushes(load, closer)) for varies, load in loads if varies]
        activity, close_activity = (
            sum(found, jnp.zeros_like(at)) for found, at in ((changes, instants), (close, closer))
        )
        gained, unseen = scene.gained(start, instants, pushes), scene.unseen(even, start)
        found = Preview(instants, activity, closer, close_activity, _knots(closer, close), gained, unseen)
        return jax.lax.stop_gradient(found)

    def steps(self, ends: Float[Array, " E"]) -> Float[Array, " E"]:
        """How many steps to each of these times, from the one before, resolve what changes fastest between the two.

        By the pace of the first look, as that of a jump has no bound, and by all that changes in the second.
        """
        begins = jnp.concatenate([self.instants[:1], ends[:-1]])
        length = jnp.diff(self.instants)
        pace = jnp.where(length > 0, jnp.diff(self.activity) / jnp.where(length > 0, length, 1.0), 0.0)
        there = jnp.clip(jnp.searchsorted(self.instants, begins, side="right") - 1, 0, pace.size - 1)
        leg = jnp.clip(jnp.searchsorted(ends, self.instants[:-1], side="right"), 0, ends.size - 1)
        fastest = pace[there].at[leg].max(pace)
        changes = jnp.diff(jnp.interp(ends, self.closer, self.closer_activity), prepend=0.0)
        return jnp.maximum(fastest * (ends - begins), changes) / _SHARE

    @property
    def mean_steps(self) -> Float[Array, ""]:
        """How many steps resolve the whole run, were it to change alike all the time."""
        return self.activity[-1] / _SHARE

    def hides_in(self, h: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a load comes and goes within a step of h s."""
        later = jnp.interp(self.instants + h, self.instants, self.activity)
        return jnp.max(later - self.activity) > _COMES_AND_GOES


def _pushes(load: Callable, instants: Float[Array, " T"]) -> Float[Array, "T m"]:
    return jnp.nan_to_num(at_each(load, instants))


def _where_they_change(instants: Float[Array, " T"], changes: list[Float[Array, " T"]]) -> Float[Array, " C"]:
    """Instants of which each function has as many: half of them spread over its activity, half over when it has any."""
    shared = jnp.zeros_like(instants)
    for activity in changes:
        for spent in (activity, jnp.cumsum(jnp.diff(activity, prepend=0.0) > 0)):
            shared = shared + spent / jnp.where(spent[-1] > 0, spent[-1], 1)
    parts = jnp.linspace(0.0, 1 - 1e-6, _CLOSER, dtype=instants.dtype)  # from before the first change to after the last
    even = instants[0] + (instants[-1] - instants[0]) * parts
    return jnp.where(shared[-1] > 0, jnp.interp(parts * shared[-1], shared, instants), even)


def _knots(instants: Float[Array, " T"], each: list[Float[Array, " T"]]) -> Float[Array, " K"]:
    """Instants about the times that part the activity of each function evenly, its begin and its end among them."""
    parts = max(_PARTS // max(len(each), 1), _LEAST_PARTS)
    shares = jnp.linspace(0.0, 1.0, parts + 1, dtype=instants.dtype).at[0].set(1e-9).at[-1].set(1 - 1e-9)
    found = [instants[:0]]
    for activity in each:
        after = jnp.searchsorted(activity, shares * activity[-1])
        found += [instants[jnp.maximum(after - 1, 0)], instants[jnp.minimum(after, instants.size - 1)]]
    return jnp.concatenate(found)


def _activity(pushed: Float[Array, "T m"]) -> Float[Array, " T"]:
    changes = jnp.sum(jnp.abs(jnp.diff(pushed, axis=0)), axis=1)
    largest = jnp.max(jnp.sum(jnp.abs(pushed), axis=1))
    return jnp.concatenate([jnp.zeros_like(largest)[None], jnp.cumsum(changes)]) / jnp.where(largest > 0, largest, 1.0)
