"""The equations of motion cut into flows that are known exactly.

A split has a *drift*, the motion without loads, and a *kick*, the loads at a frozen position, which is minus a gradient
that automatic differentiation takes from the energies.  Symmetric compositions of the two (`integrators.symplectic`) are methods
of high order that keep the energy without a trend.

Everything is per unit of the moment of inertia at rest.
"""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...motions.motion import Rotation
from ...motions.state import State
from ...shapes.projection import Projection
from ..equations import DiscreteSystem

LONGEST_TURN = math.pi / 4  # rad in a step: beyond it the rod is not seen to turn


class Center(eqx.Module):
    """The centre of mass in flight: it falls on a parabola, whatever the rod does."""

    time: Float[Array, ""]
    position: Float[Array, " D"]
    velocity: Float[Array, " D"]
    gravity: Float[Array, " D"]

    def __call__(self, t) -> tuple[Float[Array, " D"], Float[Array, " D"]]:
        passed = t - self.time
        return (
            self.position + self.velocity * passed + self.gravity * (passed**2 / 2),
            self.velocity + self.gravity * passed,
        )

    @staticmethod
    def of(scene: DiscreteSystem, t0, start: State) -> "Center | None":
        """That of a flight, else None."""
        if not scene.motion.flies:
            return None
        assert start.center is not None and start.center_velocity is not None
        down = jnp.zeros_like(start.center) if scene.gravity is None else scene.gravity
        return Center(t0, start.center, start.center_velocity, down)


def watched(field: Float[Array, "n points"]) -> Float[Array, "n places"]:
    """A field along the rod at 2 n + 3 of its points: each step looks there whether the rod collapses."""
    n, points = field.shape
    return field[:, np.unique(np.linspace(0, points - 1, 2 * n + 3).round().astype(int))]


def lowest(amplitudes: Float[Array, "n lanes"], field: Float[Array, "n places lanes"]) -> Float[Array, " lanes"]:
    """The least strain at the points where `field` is known."""
    strains = sum(a * along for a, along in zip(amplitudes, field, strict=True))
    return jnp.min(strains, axis=0)


def per_inertia(body: Projection) -> Projection:
    inertia = body.mass_matrix[0, 0]
    return eqx.tree_at(
        lambda b: (b.mass_matrix, b.stiffness_matrix, b.first_moments, b.rigidity),
        body,
        (
            body.mass_matrix / inertia,
            body.stiffness_matrix / inertia,
            body.first_moments / inertia,
            body.rigidity / inertia,
        ),
    )


def held(scene: DiscreteSystem, body: Projection) -> DiscreteSystem:
    """The scene of the turning alone: in flight about the centre of mass, where nothing weighs."""
    scene = dataclasses.replace(scene, body=body)
    return dataclasses.replace(scene, motion=Rotation(), gravity=None) if scene.motion.flies else scene


def without_center(state: State) -> State:
    return State(state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates, state.turns)


def with_center(state: State, center: Center | None, t) -> State:
    if center is None:
        return state
    position, velocity = center(t)
    return State(
        state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates, state.turns, position, velocity
    )
