"""The equations of the exact rod in motion.

With y = x + u the distance from the pivot (in flight the centre of mass) along the director d,

    rho A (y_tt - |d'|^2 y - g . d) = N_s,    N = E A W'(u_s),    l' = (int rho A y ds) d x g,    l = |d'|-vector int rho A y^2 ds

with the body and the force at the tip.  In modal amplitudes u is exact in each mode, and so is the inertia of the rod
at rest; what is cut off is the share of the higher modes in u.

Numbers are natural: time by the lowest frequency, amplitudes by the root of the inertia.  Each mode is a pair (a, b) with
a' = w b, both strains in size, so that one tolerance fits all.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..motions.state import State, heading
from .modes import Waves


class ModalPhase(NamedTuple):
    """A point in phase space: modal amplitudes and their quadratures (n,); the angle, in space the director (3,), and the
    angular momentum.

    `pointing` and `momentum` are None where the rotation is driven.  In flight `center` and `velocity` (2,) of the centre of
    mass, in units of the reach.
    """

    a: Float[Array, " n"]
    b: Float[Array, " n"]
    pointing: Any
    momentum: Any
    center: Any
    velocity: Any


class Dynamics(eqx.Module):
    """Rate of change of a `ModalPhase`: waves of a rod, its motion, gravity and the force at its tip."""

    waves: Waves
    motion: Any
    gravity: Float[Array, " D"] | None
    force: Any  # of the TipForce: a number, a vector, a function of (t, state), or None
    law: Any  # None: Hooke's
    spare: int = eqx.field(static=True)  # amplitudes that a State of this scene has

    # ---- units

    @property
    def pace(self) -> Float[Array, ""]:
        """1 / unit of time, in rad/s."""
        return self.waves.omega[0]

    @property
    def size(self) -> Float[Array, ""]:
        """Unit of the modal amplitudes, in kg^1/2 m."""
        return jnp.sqrt(self.waves.inertia)

    @property
    def driven(self) -> bool:
        return self.motion.prescribed

    # ---- from a state and back

    def encode(self, t, start: State, q: Float[Array, " n"], dq: Float[Array, " n"]) -> ModalPhase:
        """The phase with the rotation and the centre of `start`, and modal amplitudes q and their rates."""
        a, b = q / self.size, dq / (self.size * self.waves.omega)
        if self.driven:
            return ModalPhase(a, b, None, None, None, None)
        if start.planar:
            pointing, turning = start.angle, start.rate
        else:
            pointing, turning = start.direction, jnp.cross(start.direction, start.direction_rate)
        momentum = self.inertia(a) * turning / self.pace
        if start.center is None or start.center_velocity is None:
            return ModalPhase(a, b, pointing, momentum, None, None)
        reach = self.waves.reach
        return ModalPhase(a, b, pointing, momentum, start.center / reach, start.center_velocity / (reach * self.pace))

    def decode(self, t, y: ModalPhase) -> State:
        """Director, centre and their rates; the amplitudes of this state are those of the modes (m kg^1/2)."""
        direction, rate, angle = self.pointing(t, y)
        turns = jnp.zeros_like(direction[0])
        if angle is not None:
            turns = jnp.round((angle - heading(direction)) / (2 * jnp.pi))
        q, dq = self.size * y.a, self.size * self.waves.omega * y.b
        if y.center is None:
            return State(direction, rate, q, dq, turns)
        reach = self.waves.reach
        return State(direction, rate, q, dq, turns, reach * y.center, reach * self.pace * y.velocity)

    def pointing(self, t, y: ModalPhase) -> tuple[Float[Array, " D"], Float[Array, " D"], Float[Array, ""] | None]:
        """Director and its rate (1/s); in the plane the angle (rad) as well."""
        if self.driven:
            angle, rate, _ = self.motion.turning(t)
        elif y.pointing.ndim == 0:
            angle, rate = y.pointing, self.pace * y.momentum / self.inertia(y.a)
        else:
            d = y.pointing / jnp.sqrt(y.pointing @ y.pointing)
            return d, self.pace * jnp.cross(y.momentum, d) / self.inertia(y.a), None
        direction = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        return direction, rate * jnp.stack([-direction[1], direction[0]]), angle

    def inertia(self, a: Float[Array, " n"]) -> Float[Array, ""]:
        """Moment of inertia over that of the rod at rest."""
        return 1 + 2 * (self.waves.lever @ a) / self.size + a @ a

    # ---- the equations

    def __call__(self, t, y: ModalPhase, args) -> ModalPhase:
        """Rate of change by the time t * pace; t in s."""
        del args
        waves, pace, size = self.waves, self.pace, self.size
        w = waves.omega / pace
        d, rate, _ = self.pointing(t, y)
        loads = self.loads(t, y)
        db = self.pull(loads, y.a) / w + (-w * y.a if self.law is None else self._beyond_hooke(y.a) / w)
        if self.driven:
            return ModalPhase(w * y.b, db, None, None, None, None)

        push = self.tip_push(t, y, d, rate)
        reach = waves.reach + size * (waves.tip @ y.a) + loads @ waves.slack
        moment = jnp.zeros_like(d) if push is None else reach * push
        if self.gravity is not None and y.center is None:
            moment = moment + (waves.first_moment + size * (waves.moment @ y.a)) * self.gravity
        moment = moment / (waves.inertia * pace**2)
        if y.pointing.ndim == 0:
            turning, moment = y.momentum / self.inertia(y.a), d[0] * moment[1] - d[1] * moment[0]
        else:
            turning, moment = rate / pace, jnp.cross(d, moment)
        if y.center is None:
            return ModalPhase(w * y.b, db, turning, moment, None, None)
        acceleration = jnp.zeros_like(d) if push is None else push / waves.mass
        if self.gravity is not None:
            acceleration = acceleration + self.gravity
        return ModalPhase(w * y.b, db, turning, moment, y.velocity, acceleration / (waves.reach * pace**2))

    def loads(self, t, y: ModalPhase) -> Float[Array, "3"]:
        """What stretches the rod: |d'|^2 (1/s^2), g . d (m/s^2), the force at the tip along the rod (N)."""
        d, rate, _ = self.pointing(t, y)
        push, zero = self.tip_push(t, y, d, rate), jnp.zeros_like(d[0])
        weight = zero if self.gravity is None or y.center is not None else self.gravity @ d
        return jnp.stack([rate @ rate, weight, zero if push is None else push @ d])

    def pull(self, loads: Float[Array, "3"], a: Float[Array, " n"]) -> Float[Array, " n"]:
        """The loads on each mode."""
        waves = self.waves
        pull = loads[0] * (waves.lever / self.size + a)
        pull = pull + (loads[1] * waves.moment + loads[2] * waves.tip) / self.size
        return pull / self.pace**2

    def tip_push(self, t, y: ModalPhase, d, rate) -> Float[Array, " D"] | None:
        """The force at the tip as a vector, N."""
        if self.force is None:
            return None
        force: Any = self.force
        if callable(force):
            length, none = self.waves.reach + self.waves.origin, jnp.zeros(self.spare, d.dtype)
            mean = self.size * self.waves.elongation / length
            strain, growth = none.at[:1].set(mean @ y.a), none.at[:1].set((mean * self.waves.omega) @ y.b)
            full = self.decode(t, y)
            force = force(t, State(d, rate, strain, growth, full.turns, full.center, full.center_velocity))
        return force * d if jnp.ndim(force) == 0 else jnp.asarray(force)

    def _beyond_hooke(self, a: Float[Array, " n"]) -> Float[Array, " n"]:
        """-int N_k W'(strain) ds of another strain law, in the units of the modes."""
        waves = self.waves
        strain = waves.strain(self.size * a)
        _, stress = jax.jvp(self.law, (strain,), (jnp.ones_like(strain),))
        return -((waves.panels.ds * stress) @ waves.tension) / (self.size * self.pace**2)

    def static(self, t, start: State) -> Float[Array, " n"]:
        """Amplitudes at rest under the loads of the start: (omega^2 - |d'|^2) q = |d'|^2 lever + ..."""
        waves, zero = self.waves, jnp.zeros_like(self.waves.omega)
        y = self.encode(t, start, zero, zero)
        loads = self.loads(t, y)
        return self.pull(loads, zero) * self.pace**2 * self.size / (waves.omega**2 - loads[0])

    # ---- quantities

    def energy(self, t, y: ModalPhase) -> Float[Array, ""]:
        """T + V in J, V = 0 at the pivot, in flight at the origin."""
        waves = self.waves
        d, rate, _ = self.pointing(t, y)
        q, dq = self.size * y.a, self.size * waves.omega * y.b
        energy = (dq @ dq + waves.inertia * self.inertia(y.a) * (rate @ rate)) / 2
        if self.law is None:
            energy = energy + (waves.omega * q) @ (waves.omega * q) / 2
        else:
            energy = energy + waves.rigidity @ self.law(waves.strain(q))
        if y.center is not None:
            velocity = waves.reach * self.pace * y.velocity
            energy = energy + waves.mass * (velocity @ velocity) / 2
        if self.gravity is None:
            return energy
        if y.center is None:
            return energy - (waves.first_moment + waves.moment @ q) * (self.gravity @ d)
        return energy - waves.mass * waves.reach * (self.gravity @ y.center)
