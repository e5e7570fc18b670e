"""A scene in coordinates: its energies, its forces and its states as functions of q and v.

`Moving` has every amplitude as a coordinate; `Condensed` has the strain follow statically.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from ..core.linear_algebra import eigvalsh
from ..core.tracing import depends_on_first
from ..motions.force import AbstractForce
from ..motions.motion import AbstractMotion
from ..motions.state import Placement, State
from ..shapes.projection import Projection
from . import energy
from .chart import AbstractChart
from .lagrangian import Lagrangian, Phase, eliminate, solve_positive


class Scene(eqx.Module):
    """What the equations of motion are made of; the rod is projected once and stays out of the time loop."""

    motion: AbstractMotion
    body: Projection
    gravity: Float[Array, ""] | Float[Array, " D"] | None
    forces: tuple[AbstractForce, ...]

    def potential(self, place: Placement) -> Float[Array, ""]:
        """Strain energy and energy of weight in J."""
        strain = energy.elastic(self.body, place.amplitudes)
        return strain if self.gravity is None else strain + self.weight(place)

    def weight(self, place: Placement) -> Float[Array, ""]:
        """Energy of weight in J: zero at the pivot, in flight at the origin."""
        if place.center is None:
            return energy.gravity_pivoted(self.body, self.gravity, place.amplitudes, place.direction)
        return energy.gravity_center(self.body, self.gravity, place.center)

    def power(self, t, state: State, virtual: Placement) -> Float[Array, ""]:
        """Power in W of the forces in a virtual velocity."""
        powers = [force.power(t, state, virtual, self.body) for force in self.forces]
        return sum(powers, jnp.zeros_like(state.turns))

    @property
    def rate_dependent(self) -> bool:
        """Whether a force depends on rates or on full turns, as far as its program shows."""
        zero, a = jnp.zeros(()), jnp.zeros(self.body.stiffness_matrix.shape[0])
        d = jnp.zeros(self.motion.dimension).at[0].set(1.0)

        def power(rates, place, virtual):
            direction_rate, amplitude_rates, turns = rates
            state = State(place.direction, direction_rate, place.amplitudes, amplitude_rates, turns)
            return self.power(zero, state, virtual)

        place = Placement(d, a, None)
        return depends_on_first(power, (d, a, zero), place, place)


class AbstractEquations(eqx.Module):
    """The equations of motion of a scene in the coordinates of a chart."""

    scene: eqx.AbstractVar[Scene]
    chart: eqx.AbstractVar[AbstractChart]


class Moving(AbstractEquations):
    """All amplitudes of the strain move: Lagrange's equations for q = (director, amplitudes, [centre of mass])."""

    scene: Scene
    chart: AbstractChart

    @property
    def lagrangian(self) -> Lagrangian:
        """L = T - V with the generalized forces, and the mass matrix inverted as the chart knows."""
        return Lagrangian(self.function, self.force if self.scene.forces else None, self.solve)

    def function(self, t, q, v) -> Float[Array, ""]:
        """L in J."""
        scene = self.scene
        kinetic = self.chart.kinetic(scene.motion, scene.body, t, q, v)
        place = self.chart.place(scene.motion, t, q)
        if place.center is not None:
            kinetic = kinetic + energy.kinetic_center(scene.body, v[-scene.motion.dimension :])
        return kinetic - scene.potential(place)

    def force(self, t, q, v) -> Float[Array, " N"]:
        """Q = dP/dv of the virtual power P of all forces."""
        state = self.decode(t, q, v)

        def power(virtual_v):
            _, virtual = jax.jvp(lambda q: self.chart.place(self.scene.motion, t, q), (q,), (virtual_v,))
            return self.scene.power(t, state, virtual)

        return jax.grad(power)(jnp.zeros_like(v))

    def solve(self, t, q, right) -> Float[Array, " N"]:
        """M^-1 right."""
        del t
        return self.chart.solve(self.scene.motion, self.scene.body, q, right)

    def acceleration(self, t, q, v) -> Float[Array, " N"]:
        """v' from Lagrange's equations."""
        return self.lagrangian.acceleration(t, q, v)

    def encode(self, t, state: State) -> Phase:
        """q and v of a state."""
        del t
        return self.chart.encode(self.scene.motion, state)

    def decode(self, t, q, v, counted=0.0) -> State:
        """The state at t, q, v."""
        return self.chart.decode(self.scene.motion, t, q, v, counted)


class Condensed(AbstractEquations):
    """The strain follows statically: dL/da + Q_a = 0 at a' = 0, for q = (director, [centre of mass]).

    Then d/dt (dL/dv) = dL/dq + Q, taken at that strain: its mass matrix knows how the strain yields to the turning.
    """

    scene: Scene
    chart: AbstractChart

    def function(self, t, q, v, amplitudes) -> Float[Array, ""]:
        """L in J at a given strain without a rate."""
        full = Moving(self.scene, self.chart)
        return full.function(t, self._insert(q, amplitudes), self._insert(v, jnp.zeros_like(amplitudes)))

    def strain(self, t, q, v) -> Float[Array, " n"]:
        """The amplitudes that bear the load of this motion: (K - |d'|^2 M_aa) a = dL/da at a = 0."""
        body = self.scene.body
        rest = jnp.zeros(body.stiffness_matrix.shape[0], q.dtype)

        def load(amplitudes):
            push = jax.grad(self.function, argnums=3)(t, q, v, amplitudes)
            return push + self._force(t, q, v, amplitudes)[1] if self.scene.forces else push

        if not self.scene.forces:
            state = self._state(t, q, v, rest)
            spin = state.direction_rate @ state.direction_rate
            return solve_positive(body.stiffness_matrix - spin * body.strain_mass, load(rest))

        def newton(strain, _):
            return strain + eliminate(-jax.jacfwd(load)(strain), load(strain)), None

        # The first step is exact, unless a force depends on the strain and not linearly.
        return jax.lax.scan(newton, rest, length=6)[0]

    def momentum(self, t, q, v) -> Float[Array, " N"]:
        """p = dL/dv at the static strain."""
        return jax.grad(self.function, argnums=2)(t, q, v, self.strain(t, q, v))

    def acceleration(self, t, q, v) -> Float[Array, " N"]:
        """v' from Lagrange's equations."""
        strain = self.strain(t, q, v)
        push = jax.grad(self.function, argnums=1)(t, q, v, strain)
        if self.scene.forces:
            push = push + self._force(t, q, v, strain)[0]
        t = jnp.asarray(t, q.dtype)
        _, carried = jax.jvp(lambda t, q: self.momentum(t, q, v), (t, q), (jnp.ones_like(t), v))
        return solve_positive(jax.jacfwd(self.momentum, argnums=2)(t, q, v), push - carried)

    def encode(self, t, state: State) -> Phase:
        """q and v with the angular momentum of the state, whose strain is forgotten.

        Its inertia grows with the rate without bound, so that one rate below the critical fits.
        """
        full = self.chart.encode(self.scene.motion, state)
        n, size = state.amplitudes.shape[0], self.chart.size(self.scene.motion)
        q, v = (jnp.concatenate([x[:size], x[size + n :]]) for x in full)
        turning = jnp.arange(q.size) < size
        inertia, spin = self.scene.body.inertia(state.amplitudes), state.direction_rate @ state.direction_rate

        def excess(factor, _):
            strain = self.strain(t, q, jnp.where(turning, factor * v, v))
            return factor * self.scene.body.inertia(strain) / inertia - 1

        moving = spin > 0
        fastest = jnp.sqrt(critical_square(self.scene.body) / jnp.where(moving, spin, 1.0))
        bracket = {"lower": jnp.zeros_like(fastest), "upper": fastest * (1 - 1e-9)}
        halving = optx.Bisection(rtol=1e-15, atol=1e-15)
        halved = optx.root_find(excess, halving, fastest / 2, options=bracket, max_steps=80, throw=False).value
        factor = jnp.where(moving, halved, 1.0)
        return Phase(q, jnp.where(turning, factor * v, v))

    def decode(self, t, q, v, counted=0.0) -> State:
        """The state at t, q, v; its strain has no rate."""
        return self._state(t, q, v, self.strain(t, q, v), counted)

    def _state(self, t, q, v, amplitudes, counted=0.0) -> State:
        q, v = self._insert(q, amplitudes), self._insert(v, jnp.zeros_like(amplitudes))
        return self.chart.decode(self.scene.motion, t, q, v, counted)

    def _force(self, t, q, v, amplitudes) -> tuple[Float[Array, " N"], Float[Array, " n"]]:
        full = Moving(self.scene, self.chart)
        size = self.chart.size(self.scene.motion)
        force = full.force(t, self._insert(q, amplitudes), self._insert(v, jnp.zeros_like(amplitudes)))
        end = size + amplitudes.shape[0]
        return jnp.concatenate([force[:size], force[end:]]), force[size:end]

    def _insert(self, q, amplitudes):
        size = self.chart.size(self.scene.motion)
        return jnp.concatenate([q[:size], amplitudes, q[size:]])


def critical_square(body: Projection) -> Float[Array, ""]:
    """Square of the turning rate in 1/s^2 at which the strain finds no rest: the lowest eigenvalue of K a = w M_aa a."""
    return eigenvalues(body)[0]


def eigenvalues(body: Projection) -> Float[Array, " n"]:
    """Squares of the natural angular frequencies, ascending, without a derivative: for choosing steps and bounds."""
    body = jax.lax.stop_gradient(body)
    if body.root is None:
        return body.stiffness_matrix[0] / body.mass_matrix[1, 1]
    return eigvalsh(body.root.T @ body.stiffness_matrix @ body.root)
