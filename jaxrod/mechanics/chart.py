"""Coordinates for the same motion: a chart turns a `State` into generalized coordinates q, v and back.

q holds the coordinates of the director, then those of the strain, then in flight the centre of mass in m.  Where the
motion is driven the director depends on time t alone.
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..motions.motion import AbstractMotion
from ..motions.state import Placement, State, heading
from ..shapes.projection import Projection
from . import energy
from .lagrangian import Phase


class AbstractChart(eqx.Module):
    """Coordinates of the director and the strain.

    `counts_turns`: whether q itself tells how many turns were made; if not, the solver counts them step by step, from
    the angle of the first two coordinates.
    """

    counts_turns: ClassVar[bool]

    @abc.abstractmethod
    def place(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"]) -> Placement:
        """The placement of the rod at q."""

    @abc.abstractmethod
    def encode(self, motion: AbstractMotion, state: State) -> Phase:
        """q and v of one state."""

    @abc.abstractmethod
    def kinetic(
        self, motion: AbstractMotion, body: Projection, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]
    ) -> Float[Array, ""]:
        """Kinetic energy in J of turning and stretching."""

    @abc.abstractmethod
    def solve(
        self, motion: AbstractMotion, body: Projection, q: Float[Array, " N"], right: Float[Array, " N"]
    ) -> Float[Array, " N"]:
        """M^-1 right for the mass matrix M of the kinetic energy, in closed form."""

    @abc.abstractmethod
    def turns(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], counted: Any) -> Float[Array, ""]:
        """Full turns made, given those that the solver counted."""

    @abc.abstractmethod
    def size(self, motion: AbstractMotion) -> int:
        """How many coordinates the director has."""

    def decode(
        self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], v: Float[Array, " N"], counted: Any = 0.0
    ) -> State:
        """The state at t, q, v."""
        t = jnp.asarray(t, q.dtype)
        place, rate = jax.jvp(lambda t, q: self.place(motion, t, q), (t, q), (jnp.ones_like(t), v))
        turns = jnp.asarray(jax.lax.stop_gradient(self.turns(motion, t, q, counted)), q.dtype)
        return State(
            place.direction, rate.direction, place.amplitudes, rate.amplitudes, turns, place.center, rate.center
        )


class Angles(AbstractChart):
    """The paper's coordinates: q = (psi, [phi in space], amplitudes).  Any rung; singular at the pole."""

    counts_turns: ClassVar[bool] = True

    def size(self, motion: AbstractMotion):
        return motion.dimension - 1

    def place(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"]):
        angles, amplitudes, center = _parts(motion, q, self.size(motion))
        flat = jnp.cos(angles[0])
        if motion.dimension == 2:
            return Placement(jnp.stack([flat, jnp.sin(angles[0])]), amplitudes, center)
        direction = jnp.stack([flat * jnp.cos(angles[1]), flat * jnp.sin(angles[1]), jnp.sin(angles[0])])
        return Placement(direction, amplitudes, center)

    def encode(self, motion: AbstractMotion, state: State):
        if motion.dimension == 2:
            angles, rates = state.angle[None], state.rate[None]
        else:
            angles = jnp.stack([state.angle, state.azimuth])
            rates = jnp.stack([state.rate, state.azimuth_rate])
        return _join(state, angles, rates, state.amplitudes, state.amplitude_rates)

    def kinetic(self, motion: AbstractMotion, body: Projection, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]):
        angles, a, _ = _parts(motion, q, self.size(motion))
        rates, da, _ = _parts(motion, v, self.size(motion))
        if motion.dimension == 2:
            return energy.kinetic_rotation(body, a, da, rates[0])
        return energy.kinetic_spherical(body, a, da, angles[0], rates[0], rates[1])

    def solve(self, motion: AbstractMotion, body: Projection, q: Float[Array, " N"], right: Float[Array, " N"]):
        angles, a, _ = _parts(motion, q, self.size(motion))
        turning, stretching, moving = _parts(motion, right, self.size(motion))
        inertia = body.inertia(a)[None]
        if motion.dimension == 3:
            inertia = jnp.concatenate([inertia, inertia * jnp.cos(angles[:1]) ** 2])
        return _whole(body, turning / inertia, body.solve_strain(stretching), moving)

    def turns(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], counted: Any):
        del counted
        # Past the pole (cos psi < 0) the rod points to the azimuth phi + pi.
        angle = q[0] if motion.dimension == 2 else q[1] + jnp.pi * (jnp.cos(q[0]) < 0)
        return jnp.round((angle - heading(self.place(motion, t, q).direction)) / (2 * jnp.pi))


class Embedded(AbstractChart):
    """q = (1 + eps) d, for uniform strain: the rod is a swinging spring, its kinetic energy flat, no pole anywhere.

    The strain is |q| - 1, so it carries an absolute error of one rounding of 1.  The only singular point is q = 0.
    """

    counts_turns: ClassVar[bool] = False

    def size(self, motion: AbstractMotion):
        return motion.dimension

    def place(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"]):
        q, _, center = _parts(motion, q, self.size(motion))
        stretch = jnp.sqrt(q @ q)
        return Placement(q / stretch, stretch[None] - 1, center)

    def encode(self, motion: AbstractMotion, state: State):
        if state.amplitudes.shape != (1,):
            raise ValueError(
                f"chart=Embedded() needs one uniform strain but the basis has {state.amplitudes.shape[0]}; take "
                "basis=Ritz(1) or chart=Director()."
            )
        stretch, stretching = 1 + state.amplitudes[0], state.amplitude_rates[0]
        none = state.amplitudes[:0]
        velocity = stretching * state.direction + stretch * state.direction_rate
        return _join(state, stretch * state.direction, velocity, none, none)

    def kinetic(self, motion: AbstractMotion, body: Projection, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]):
        return energy.kinetic_embedded(body, _parts(motion, v, self.size(motion))[0])

    def solve(self, motion: AbstractMotion, body: Projection, q: Float[Array, " N"], right: Float[Array, " N"]):
        flat, none, moving = _parts(motion, right, self.size(motion))
        return _whole(body, flat / body.mass_matrix[0, 0], none, moving)

    def turns(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], counted: Any):
        return counted


class Director(AbstractChart):
    """q = (y, amplitudes) with the director d = y / |y|: any rung, no pole.

    |y| is a gauge: it enters no energy but a kinetic term of its own, 1/2 M_00 (d/dt ln |y|)^2, which keeps the mass
    matrix positive.  The gauge decouples, and its momentum, zero at the start, stays zero.
    """

    counts_turns: ClassVar[bool] = False

    def size(self, motion: AbstractMotion):
        return motion.dimension

    def place(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"]):
        y, amplitudes, center = _parts(motion, q, self.size(motion))
        return Placement(y / jnp.sqrt(y @ y), amplitudes, center)

    def encode(self, motion: AbstractMotion, state: State):
        return _join(state, state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates)

    def kinetic(self, motion: AbstractMotion, body: Projection, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]):
        y, a, _ = _parts(motion, q, self.size(motion))
        dy, da, _ = _parts(motion, v, self.size(motion))
        square = y @ y
        growth = (y @ dy) / square
        dd = (dy - growth * y) / jnp.sqrt(square)
        return energy.kinetic_director(body, a, da, dd) + body.mass_matrix[0, 0] * growth**2 / 2

    def solve(self, motion: AbstractMotion, body: Projection, q: Float[Array, " N"], right: Float[Array, " N"]):
        y, a, _ = _parts(motion, q, self.size(motion))
        turning, stretching, moving = _parts(motion, right, self.size(motion))
        square = y @ y
        along = (y @ turning) / square * y
        turning = square * ((turning - along) / body.inertia(a) + along / body.mass_matrix[0, 0])
        return _whole(body, turning, body.solve_strain(stretching), moving)

    def turns(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], counted: Any):
        return counted


class Strains(AbstractChart):
    """q = amplitudes: all that is left where the rotation is prescribed (`Driven`)."""

    counts_turns: ClassVar[bool] = True

    def size(self, motion: AbstractMotion):
        return 0

    def place(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"]):
        angle, _, _ = motion.turning(t)
        return Placement(jnp.stack([jnp.cos(angle), jnp.sin(angle)]), q, None)

    def encode(self, motion: AbstractMotion, state: State):
        return Phase(state.amplitudes, state.amplitude_rates)

    def kinetic(self, motion: AbstractMotion, body: Projection, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]):
        _, rate, _ = motion.turning(t)
        return energy.kinetic_rotation(body, q, v, rate)

    def solve(self, motion: AbstractMotion, body: Projection, q: Float[Array, " N"], right: Float[Array, " N"]):
        return body.solve_strain(right)

    def turns(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], counted: Any):
        del counted
        return jnp.round((motion.turning(t)[0] - heading(self.place(motion, t, q).direction)) / (2 * jnp.pi))


class Local(AbstractChart):
    """q = (xi, amplitudes) about a director `base` (D,) that turns steadily at `spin` (rad/s): equilibria and modes.

    xi (D - 1,) are slopes along the tangents of `base`, in space sideways and up.  The turning is in the plane, in space
    about the vertical.  The centre of mass is left out.
    """

    base: Float[Array, " D"]
    spin: Float[Array, ""]

    counts_turns: ClassVar[bool] = False

    def size(self, motion: AbstractMotion):
        return motion.dimension - 1

    def place(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"]):
        slopes, amplitudes = q[: self.size(motion)], q[self.size(motion) :]
        d = (self.base + self.tangents() @ slopes) / jnp.sqrt(1 + slopes @ slopes)
        cos, sin = jnp.cos(self.spin * t), jnp.sin(self.spin * t)
        turned = jnp.concatenate([jnp.stack([cos * d[0] - sin * d[1], sin * d[0] + cos * d[1]]), d[2:]])
        return Placement(turned, amplitudes, None)

    def tangents(self) -> Float[Array, "D D-1"]:
        """Unit vectors across `base`: (-y, x) in the plane; in space horizontal and, across both, upwards."""
        d = self.base
        if d.shape == (2,):
            return jnp.stack([-d[1], d[0]])[:, None]
        square = d[0] ** 2 + d[1] ** 2
        polar = square < 1e-20
        flat = jnp.stack([-d[1], d[0]]) / jnp.sqrt(jnp.where(polar, 1.0, square))
        sideways = jnp.concatenate([jnp.where(polar, jnp.array([1.0, 0.0], d.dtype), flat), jnp.zeros(1, d.dtype)])
        return jnp.stack([sideways, jnp.cross(d, sideways)], axis=1)

    def encode(self, motion: AbstractMotion, state: State):
        del motion
        zero = jnp.zeros_like(self.base[1:])
        return Phase(jnp.concatenate([zero, state.amplitudes]), jnp.concatenate([zero, state.amplitude_rates]))

    def kinetic(self, motion: AbstractMotion, body: Projection, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]):
        t = jnp.asarray(t, q.dtype)
        place, rate = jax.jvp(lambda t, q: self.place(motion, t, q), (t, q), (jnp.ones_like(t), v))
        return energy.kinetic_director(body, place.amplitudes, rate.amplitudes, rate.direction)

    def solve(self, motion: AbstractMotion, body: Projection, q: Float[Array, " N"], right: Float[Array, " N"]):
        slopes, a = q[: self.size(motion)], q[self.size(motion) :]
        stretch = 1 + slopes @ slopes  # |d'|^2 = (|xi'|^2 - (xi . xi')^2 / stretch) / stretch
        turning, stretching = right[: self.size(motion)], right[self.size(motion) :]
        turning = stretch * (turning + slopes * (slopes @ turning)) / body.inertia(a)
        return jnp.concatenate([turning, body.solve_strain(stretching)])

    def turns(self, motion: AbstractMotion, t: Any, q: Float[Array, " N"], counted: Any):
        return counted


def _parts(motion: AbstractMotion, q, size: int):
    """q cut into `size` coordinates of the director, the strain amplitudes, and in flight the centre of mass."""
    if motion.flies:
        return q[:size], q[size : -motion.dimension], q[-motion.dimension :]
    return q[:size], q[size:], None


def _join(state: State, director, director_rate, amplitudes, amplitude_rates) -> Phase:
    q, v = [director, amplitudes], [director_rate, amplitude_rates]
    if state.center is not None:
        q.append(state.center)
        v.append(state.center_velocity)
    return Phase(jnp.concatenate(q), jnp.concatenate(v))


def _whole(body: Projection, turning, stretching, moving):
    """The parts of M^-1 right as one vector; the centre of mass moves with the mass of the rod."""
    parts = [turning, stretching] if moving is None else [turning, stretching, moving / body.mass]
    return jnp.concatenate(parts)
