"""What a run kept that physics keeps, and how near it came to where the model ends: one line of numbers for each scene."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.equations import DiscreteSystem
from ..mechanics.system import System
from ..motions.state import State


class Ledger(eqx.Module):
    """The books of a run, over its start and its saved states; it prints itself.  Leading axes are scenes.

    - `energy`: the largest change of T + V over the largest sum of its parts (T, strain energy, |weight|); in flight that
      of the motion about the centre of mass.  None where it need not be kept: forces, a drive, `QuasiStatic`.
    - `angular_momentum`: the largest change over the most that the run's energy could turn, (2 energy J)^1/2: in the plane
      about a pivot without gravity, in flight about the centre of mass, in space its part along gravity, or all of it
      without gravity.  None where it need not be kept.
    - `largest_strain`: the largest size of the strain along the rod.
    - `room`: how near it came to collapse, 1 + the least strain along the rod, of equal steps at any of them.
    - `turning`: the most the rod turned in a step, in rad, by its fastest rate and its mean step.
    """

    energy: Float[Array, "*scenes"] | None
    angular_momentum: Float[Array, "*scenes"] | None
    largest_strain: Float[Array, "*scenes"]
    room: Float[Array, "*scenes"]
    turning: Float[Array, "*scenes"]

    def __str__(self):
        return "\n".join(
            [
                f"energy: {_change(self.energy)}",
                f"angular momentum: {_change(self.angular_momentum)}",
                f"strain: at most {_range(self.largest_strain, jnp.nanmax)}, room to collapse "
                f"{_range(self.room, jnp.nanmin)}",
                f"turning: at most {_range(self.turning, jnp.nanmax)} rad in a step",
            ]
        )


def account(system: System, start: State, states: State, stats: dict[str, Array]) -> Ledger:
    """The ledger of one scene from its start, its saved states (leading axis T) and the counts of its run."""
    scene, all_ = system.discrete, with_start(start, states)
    turned = jnp.sum(all_.direction_rate**2, axis=-1)
    strain = scene.body.field(all_.amplitudes) if scene.n else jnp.zeros((*turned.shape, 1), turned.dtype)
    conserved, momentum = _kept(scene, all_)
    return Ledger(
        energy=conserved,
        angular_momentum=momentum,
        largest_strain=jnp.nanmax(jnp.abs(strain)),
        room=1 + jnp.minimum(jnp.nanmin(strain), stats.get("lowest_strain", jnp.inf)),
        turning=jnp.sqrt(jnp.nanmax(turned)) * stats["step"],
    )


def with_start(start: State, states: State) -> State:
    """The states (leading axis T) after the one that they began with."""
    return jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, states)


def is_closed(scene: System | DiscreteSystem) -> bool:
    """Whether nothing feeds or drains the scene: no forces beside weight, no drive."""
    return not scene.forces and not scene.motion.prescribed


def energy_change(scene: DiscreteSystem, states: State) -> tuple[Float[Array, " T"], Float[Array, ""]]:
    """T + V of the states less that of the first, in J, and the scale to see it by: the largest sum of its parts.

    In flight without the centre of mass, which decouples and falls exactly.
    """

    def parts(state):
        turning, strain, weight = scene.energies(state)
        return jnp.stack([turning, strain, 0 * weight if scene.motion.flies else weight])

    found = jax.vmap(parts)(states)
    # Part by part: of a stiff rod's large and constant parts the sum would lose what little has changed.
    return jnp.sum(found - found[:1], axis=1), jnp.nanmax(jnp.sum(jnp.abs(found), axis=1))


def _kept(scene: DiscreteSystem, states: State) -> tuple[Float[Array, ""] | None, Float[Array, ""] | None]:
    """Change of energy and of angular momentum, each None where the scene need not keep it."""
    if not is_closed(scene):
        return None, None
    change, size = energy_change(scene, states)
    energy = None if scene.condensed else over(jnp.nanmax(jnp.abs(change)), size)
    axis = _axis(scene)
    if axis is None:
        return energy, None
    momentum = jax.vmap(scene.angular_momentum)(states)
    along = momentum[:, None] if momentum.ndim == 1 else momentum @ axis
    inertia = jnp.nanmax(scene.body.inertia(states.amplitudes))
    # Over its scale first, and root by root: squares of a large rod's momentum are beyond float32.
    change = over(along - along[:1], jnp.sqrt(2 * size) * jnp.sqrt(inertia))
    return energy, jnp.sqrt(jnp.nanmax(jnp.sum(change**2, axis=-1)))


def _axis(scene: DiscreteSystem) -> Float[Array, "D kept"] | None:
    """Directions along which the angular momentum is kept, as columns; in the plane there is one; None if there are none."""
    dimension, gravity = scene.motion.dimension, scene.gravity
    if gravity is None or scene.motion.flies:
        return jnp.eye(dimension, dtype=scene.body.mass_matrix.dtype)
    if dimension == 2:
        return None
    size = jnp.sqrt(gravity @ gravity)
    return over(gravity, size)[:, None]


def over(change, size):
    """Of a size that may be zero."""
    return change / jnp.where(size > 0, size, 1.0)


def _change(kept) -> str:
    return "not kept by this scene" if kept is None else f"changed by {_range(kept, jnp.nanmax)}"


def _range(values, worst) -> str:
    if jnp.ndim(values) == 0:
        return f"{float(values):.3g}"
    return f"{float(worst(values)):.3g} (the worst of {jnp.size(values)} scenes)"
