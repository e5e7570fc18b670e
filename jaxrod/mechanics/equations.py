"""A scene in coordinates: its energies, its forces and its states as functions of q and v.

`Moving` has every amplitude as a coordinate; `Condensed` has the strain follow statically.
"""

import abc
import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ..core import tracing
from ..core.linear_algebra import eigvalsh
from ..motions.force import AbstractForce
from ..motions.motion import AbstractMotion
from ..motions.signal import signals
from ..motions.state import Placement, State
from ..shapes.projection import Projection
from . import energy
from .chart import AbstractChart
from .lagrangian import Lagrangian, Phase, eliminate, solve_positive


class DiscreteSystem(eqx.Module):
    """A scene as its strain basis sees it, built once a run by `System.discrete`: all that the equations of motion need.

    `body`, the rod projected; `gravity`, a vector (D,) in m/s^2 or None; `length` of the rod in m; `condensed`, whether the
    strain has no motion of its own; `uniform`, whether it is one strain all along.
    """

    motion: AbstractMotion
    body: Projection
    gravity: Float[Array, " D"] | None
    forces: tuple[AbstractForce, ...]
    length: Float[Array, ""]
    condensed: bool = eqx.field(static=True)
    uniform: bool = eqx.field(static=True)

    @property
    def n(self) -> int:
        """How many amplitudes the strain has."""
        return self.body.stiffness_matrix.shape[0]

    # ---- energies and powers

    def equations(self, chart: AbstractChart) -> "Moving | Condensed":
        """The equations of motion in the coordinates of `chart`."""
        return (Condensed if self.condensed else Moving)(self, chart)

    def potential(self, place: Placement) -> Float[Array, ""]:
        """Strain energy and energy of weight in J."""
        strain = energy.elastic(self.body, place.amplitudes)
        return strain if self.gravity is None else strain + self.weight(place)

    def weight(self, place: Placement) -> Float[Array, ""]:
        """Energy of weight in J: zero at the pivot, in flight at the origin."""
        assert self.gravity is not None
        if place.center is None:
            return energy.gravity_pivoted(self.body, self.gravity, place.amplitudes, place.direction)
        return energy.gravity_center(self.body, self.gravity, place.center)

    def energies(self, state: State) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """Kinetic energy without that of the centre of mass, strain energy and energy of weight, in J."""
        turning = energy.kinetic_director(self.body, state.amplitudes, state.amplitude_rates, state.direction_rate)
        place = Placement(state.direction, state.amplitudes, state.center)
        weight = jnp.zeros_like(turning) if self.gravity is None else self.weight(place)
        return turning, energy.elastic(self.body, state.amplitudes), weight

    def moving(self, center_velocity: Float[Array, " D"]) -> Float[Array, ""]:
        """Kinetic energy of the centre of mass in flight, in J."""
        return energy.kinetic_center(self.body, center_velocity)

    def all_energies(self, state: State) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """The same as `energies`, with the kinetic energy of the centre of mass."""
        turning, elastic, weight = self.energies(state)
        moving = turning if state.center_velocity is None else turning + self.moving(state.center_velocity)
        return moving, elastic, weight

    def power(self, t: Any, state: State, virtual: Placement) -> Float[Array, ""]:
        """Power in W of the forces in a virtual velocity."""
        powers = [force.power(t, state, virtual, self.body) for force in self.forces]
        return sum(powers, jnp.zeros_like(state.turns))

    @property
    def rate_dependent(self) -> bool:
        """Whether a force depends on rates or on full turns, as far as its program shows."""
        zero, a = jnp.zeros(()), jnp.zeros(self.n)
        d = jnp.zeros(self.motion.dimension).at[0].set(1.0)

        def power(rates, place, virtual):
            direction_rate, amplitude_rates, turns = rates
            state = State(place.direction, direction_rate, place.amplitudes, amplitude_rates, turns)
            return self.power(zero, state, virtual)

        place = Placement(d, a, None)
        return tracing.depends_on_first(power, (d, a, zero), place, place)

    # ---- what its numbers say

    def angular_momentum(self, state: State) -> Float[Array, ""] | Float[Array, " 3"]:
        """About the pivot (in flight the centre of mass) in kg m^2/s: in space a vector."""
        inertia = self.body.inertia(state.amplitudes)
        return inertia * state.rate if state.planar else inertia * jnp.cross(state.direction, state.direction_rate)

    def tip(self, state: State) -> Float[Array, " D"]:
        """Position of the tip in m."""
        tip = self.body.reach(state.amplitudes) * state.direction
        return tip if state.center is None else tip + state.center

    def lowest_strain(self, amplitudes: Float[Array, " n"]) -> Float[Array, ""]:
        """The least strain along the rod, or zero if all are above."""
        return jnp.min(amplitudes if self.uniform else self.body.field(amplitudes), initial=0.0)

    def valid(self, start: State) -> Bool[Array, ""]:
        """Whether a start makes sense: what is asked of known numbers, for traced ones."""
        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(start)]))
        return finite & (self.lowest_strain(start.amplitudes) > -1) if self.n else finite

    @property
    def fastest_swing(self) -> Float[Array, ""]:
        """What gravity may add to the square of the turning rate, in 1/s^2: 4 |g| S / J, from the highest place to the lowest."""
        if self.gravity is None or self.motion.flies:
            return jnp.zeros_like(self.body.mass_matrix[0, 0])
        weight = jnp.sqrt(jnp.sum(self.gravity**2))
        return 4 * jnp.abs(weight * self.body.first_moments[0]) / self.body.mass_matrix[0, 0]

    # ---- loads, as a look before the run asks for them (`motions/preview.py`)

    def loads(self, start: State) -> list[tuple[bool, Callable[[Any], Array]]]:
        """What drives it, as functions of time at its start: generalized forces, those of the director first.

        With each whether it is bare: nothing else says where it changes.
        """
        motion = self.motion
        drives = [(True, lambda t: motion.turning(t)[1][None] ** 2)] if motion.prescribed else []
        timed = [force for force in self.forces if force.varies or signals(force)]
        pushed = [(force.varies, functools.partial(force.pushed, state=start, body=self.body)) for force in timed]
        return [*drives, *pushed]

    def gained(self, start: State, instants: Float[Array, " T"], pushes: list) -> Float[Array, ""]:
        """The most by which these loads (T, m) change the turning rate: their impulses about the pivot over the moment of
        inertia."""
        if self.motion.prescribed:
            return jnp.zeros_like(instants[0])
        moment = sum(pushed[:, : start.direction.size] for pushed in pushes)
        moment = moment - (moment @ start.direction)[:, None] * start.direction[None, :]
        steps = jnp.diff(instants)[:, None] * (moment[1:] + moment[:-1]) / 2
        return jnp.max(jnp.linalg.norm(jnp.cumsum(steps, axis=0), axis=1)) / self.body.mass_matrix[0, 0]

    def unseen(self, times: Float[Array, " T"], start: State) -> Bool[Array, ""]:
        """Whether a load may have been missed at all of these instants."""
        unseen = self.motion.unseen(times)
        for force in self.forces:
            unseen = unseen | force.unseen(times, start, self.body)
        return unseen


class AbstractEquations(eqx.Module):
    """The equations of motion of a scene in the coordinates of a chart."""

    scene: eqx.AbstractVar[DiscreteSystem]
    chart: eqx.AbstractVar[AbstractChart]

    @abc.abstractmethod
    def acceleration(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """v' from Lagrange's equations."""

    def from_rest(self, q: Float[Array, " N"]) -> Float[Array, " N"]:
        """v' at t = 0 and v = 0 in coordinates that turn steadily with the rod."""
        return self.acceleration(0.0, q, jnp.zeros_like(q))


class Moving(AbstractEquations):
    """All amplitudes of the strain move: Lagrange's equations for q = (director, amplitudes, [centre of mass])."""

    scene: DiscreteSystem
    chart: AbstractChart

    @property
    def lagrangian(self) -> Lagrangian:
        """L = T - V with the generalized forces, and the mass matrix inverted as the chart knows."""
        return Lagrangian(self.function, self.force if self.scene.forces else None, self.solve)

    def function(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, ""]:
        """L in J."""
        scene = self.scene
        kinetic = self.chart.kinetic(scene.motion, scene.body, t, q, v)
        place = self.chart.place(scene.motion, t, q)
        if place.center is not None:
            kinetic = kinetic + energy.kinetic_center(scene.body, v[-scene.motion.dimension :])
        return kinetic - scene.potential(place)

    def force(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """Q = dP/dv of the virtual power P of all forces."""
        state = self.decode(t, q, v)

        def power(virtual_v):
            _, virtual = jax.jvp(lambda q: self.chart.place(self.scene.motion, t, q), (q,), (virtual_v,))
            return self.scene.power(t, state, virtual)

        return jax.grad(power)(jnp.zeros_like(v))

    def solve(self, t: Any, q: Float[Array, " N"], right: Float[Array, " N"]) -> Float[Array, " N"]:
        """M^-1 right."""
        del t
        return self.chart.solve(self.scene.motion, self.scene.body, q, right)

    def acceleration(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """v' from Lagrange's equations."""
        return self.lagrangian.acceleration(t, q, v)

    def from_rest(self, q: Float[Array, " N"]):
        # Momenta do not change by themselves then: without what Lagrange's equations have for that half the program.
        still = jnp.zeros_like(q)
        push = jax.grad(self.function, argnums=1)(0.0, q, still)
        return self.solve(0.0, q, push + self.force(0.0, q, still) if self.scene.forces else push)

    def encode(self, t: Any, state: State) -> Phase:
        """q and v of a state."""
        del t
        return self.chart.encode(self.scene.motion, state)

    def decode(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"], counted: Any = 0.0) -> State:
        """The state at t, q, v."""
        return self.chart.decode(self.scene.motion, t, q, v, counted)


class Condensed(AbstractEquations):
    """The strain follows statically: dL/da + Q_a = 0 at a' = 0, for q = (director, [centre of mass]).

    Then d/dt (dL/dv) = dL/dq + Q, taken at that strain: its mass matrix knows how the strain yields to the turning.
    """

    scene: DiscreteSystem
    chart: AbstractChart

    def function(
        self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"], amplitudes: Float[Array, " n"]
    ) -> Float[Array, ""]:
        """L in J at a given strain without a rate."""
        full = Moving(self.scene, self.chart)
        return full.function(t, self._insert(q, amplitudes), self._insert(v, jnp.zeros_like(amplitudes)))

    def strain(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " n"]:
        """The amplitudes that bear the load of this motion: (K - |d'|^2 M_aa) a = dL/da at a = 0."""
        body = self.scene.body
        rest = jnp.zeros(self.scene.n, q.dtype)

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

    def momentum(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """p = dL/dv at the static strain."""
        return jax.grad(self.function, argnums=2)(t, q, v, self.strain(t, q, v))

    def acceleration(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """v' from Lagrange's equations."""
        strain = self.strain(t, q, v)
        push = jax.grad(self.function, argnums=1)(t, q, v, strain)
        if self.scene.forces:
            push = push + self._force(t, q, v, strain)[0]
        t = jnp.asarray(t, q.dtype)
        _, carried = jax.jvp(lambda t, q: self.momentum(t, q, v), (t, q), (jnp.ones_like(t), v))
        return solve_positive(jax.jacfwd(self.momentum, argnums=2)(t, q, v), push - carried)

    def encode(self, t: Any, state: State) -> Phase:
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

    def decode(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"], counted: Any = 0.0) -> State:
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
