"""Whether a run by equal steps is to be believed: by the energy it kept, and by another with fewer steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..core.linear_algebra import eigvalsh
from ..integrators.fixed_step import Route, Walker
from ..integrators.splitting import AbstractStepper
from ..mechanics.energy import gravity_pivoted, kinetic_director
from ..mechanics.equations import DiscreteSystem
from ..motions.state import State
from ..motions.stops import Stops
from .invariants import energy_change, is_closed, over, with_start
from .scales import Scales
from .step_policy import StepPolicy

MOST_STEPS = 2**30 - 1  # that are counted: two such numbers still have a sum
_SEEN = 8  # save times at which a run is compared with another


def steps_so_far(counts: Int[Array, " E"]) -> Int[Array, " E"]:
    """Steps to each time in all, or `MOST_STEPS`."""
    # Floats, which do not overflow, tell where integers would; an associative scan takes XLA minutes to compile.
    return jnp.where(jnp.cumsum(counts.astype(float)) < MOST_STEPS, jnp.cumsum(counts), MOST_STEPS)


def energy_lost(scene: DiscreteSystem, start: State, states: State, reached) -> Float[Array, ""]:
    """Largest change of the energy at a save time over what moves in it; zero where it need not keep its energy."""
    if not is_closed(scene):
        return jnp.zeros_like(start.turns)
    change, size = energy_change(scene, jax.lax.stop_gradient(with_start(start, states)))
    change = jnp.max(jnp.where(reached, jnp.abs(change[1:]), 0.0))
    return jax.lax.stop_gradient(over(change, size))


class Comparison(eqx.Module):
    """Another run from the same start with fewer steps, which is held against a run.

    At K of the save times, of which those `looked` at count: at the end alone two errors that oscillate may meet.  `whole`:
    they are looked at to the end.  Else, where little is to be feared, in the first part of the run, of which the rest is
    thought to be off in proportion.
    """

    route: Route
    halts: Stops
    looked: Bool[Array, " K"]
    whole: Bool[Array, ""]
    seen: tuple[int, ...] = eqx.field(static=True)  # of the save times

    @staticmethod
    def of(
        scene: DiscreteSystem,
        start: State,
        scales: Scales,
        t0: Float[Array, ""],
        ts: Float[Array, " T"],
        stops: Stops,
        steps: Int[Array, " E"],
        policy: StepPolicy,
    ) -> "Comparison | None":
        """That of a run of so many `steps`.

        None where the energy tells: it does not where loads do not keep it, where large strains hide the error from it, where
        the rod may linger upside down, and in float32, whose rounding it does not show.
        """
        always = not is_closed(scene) or t0.dtype == jnp.float32
        if not always and scene.n < 2:
            return None
        parts = min(_SEEN, ts.size)
        whole = jnp.asarray(always) | (scales.strain > policy.hard) | _may_linger(scene, start, policy)
        seen = np.unique(np.linspace(0, ts.size - 1, parts + 1)[1:].astype(int))
        later = ts[seen] > t0
        looked = whole | ((jnp.arange(parts) == jnp.argmax(later)) & (jnp.sum(later) > 1))
        halts = Stops.merged(t0, ts[seen], stops.inner)
        reached = seen if stops.inner is None else stops.last_until(halts.ends)
        legs = jnp.diff(steps_so_far(steps)[reached], prepend=0)
        fewer = jnp.where(legs == 1, 2, jnp.round(policy.fewer * legs).astype(legs.dtype))
        fewer = fewer * looked if stops.inner is None else fewer  # loads are looked at to the end
        route = Route(t0, halts.ends, fewer, fewer, halts.ends.size == 1)
        return Comparison(route, halts, looked, whole, tuple(seen.tolist()))

    def off(
        self, scene: DiscreteSystem, split: AbstractStepper, ts: Float[Array, " T"], states: State, walkers: Walker
    ) -> Float[Array, " K"]:
        """By how much the tip is elsewhere, over the furthest it was out, at least the length."""
        other, seen = self.halts.at_saves(walkers), np.array(self.seen)

        def tip(state: State) -> Float[Array, " D"]:  # in flight from the centre of mass
            return scene.body.reach(state.amplitudes) * state.direction

        here = jax.vmap(tip)(states)
        there = jax.vmap(tip)(jax.vmap(split.decode)(ts[seen], other.y, other.turns))
        size = jnp.maximum(jnp.max(jnp.linalg.norm(here, axis=-1)), scene.length)
        return jax.lax.stop_gradient(jnp.linalg.norm(here[seen] - there, axis=-1) / size)

    def passed(
        self,
        off: Float[Array, " K"],
        tolerance: Float[Array, ""],
        turned: Float[Array, ""],
        single: Bool[Array, ""],
        policy,
    ) -> Bool[Array, ""]:
        """Whether that is little, of a run that `turned` so many rad; `single`: whether a leg of it is one step, which is held
        against two, less apart than fewer and all."""
        name = tolerance.dtype.name
        bound = policy.unresolved[name] * (tolerance + policy.each_radian[name] * turned)
        bound = bound * jnp.where(self.whole, 1.0, policy.at_first)
        if self.halts.inner is not None:
            bound = jnp.where(single, bound / 2, bound)
        return jnp.all((off <= bound) | ~self.looked)


def foreseen(scene: DiscreteSystem, scales: Scales, tolerance: Float[Array, ""], policy: StepPolicy) -> Bool[Array, ""]:
    """Whether the start shows what will come, and rounding leaves the tolerance within reach."""
    name = tolerance.dtype.name
    seen = jnp.asarray(scene.motion.prescribed) | (scales.strain <= policy.hopeless[name])
    if name == "float32" and scene.n > 1:
        seen = seen & (_condition(scene) * jnp.finfo(tolerance.dtype).eps <= tolerance)
    return seen


def _may_linger(scene: DiscreteSystem, start: State, policy: StepPolicy) -> Bool[Array, ""]:
    """Whether the rod may come to a stop near its inverted equilibrium, where what it is off by grows exponentially."""
    if scene.gravity is None or scene.motion.flies:
        return jnp.asarray(False)
    straight = jnp.zeros_like(start.amplitudes)
    energy = kinetic_director(scene.body, straight, straight, start.direction_rate)
    energy = energy + gravity_pivoted(scene.body, scene.gravity, straight, start.direction)
    top = jnp.sqrt(jnp.sum(scene.gravity**2)) * jnp.abs(scene.body.moment(straight))
    return jax.lax.stop_gradient(jnp.abs(energy - top) < policy.lingering * top)


def _condition(scene: DiscreteSystem) -> Float[Array, ""]:
    """By how much rounding grows in the mass matrix of the strain."""
    mass = jax.lax.stop_gradient(scene.body.strain_mass)
    size = jnp.sqrt(jnp.diagonal(mass))
    spread = eigvalsh(mass / (size[:, None] * size[None, :]))
    return spread[-1] / jnp.maximum(spread[0], jnp.finfo(mass.dtype).eps)
