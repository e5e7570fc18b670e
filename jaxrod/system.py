"""One scene's physics: a rod, how it is held, its strain basis, gravity and forces."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import checks, energy
from .basis import Projection, Ritz
from .chart import AbstractChart
from .force import AbstractForce
from .lagrangian import Lagrangian
from .motion import AbstractMotion, AbstractPivoted, Flight, Placement, State, heading
from .rod import Lumped, Rod


class System(eqx.Module):
    """A scene.  It stores its inputs only, so `dataclasses.replace` gives a right new scene, under `jit` and `vmap` too.

    **Arguments:**

    - `rod`: a `Rod`, or a `Lumped` body.
    - `motion`: `Rotation()`, `Spherical()` or `Flight()`.
    - `basis`: `Ritz(0)` (rigid) or `Ritz(1)` (the paper's uniform strain).
    - `gravity`: g in m/s^2, downwards, or None.
    - `forces`: forces without a potential, such as `Torque` and `PivotFriction`.

    What is left out (`gravity=None`, `forces=()`, `Ritz(0)`) is not computed.

    >>> import jaxrod
    >>> cone = jaxrod.Cone(root_radius=0.02, tip_radius=0.03)
    >>> rod = jaxrod.Rod(length=1.0, section=cone, young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, motion=jaxrod.Rotation(), basis=jaxrod.Ritz(1), gravity=9.81)
    >>> print(f"{system.energy(system.state(angle=0.0, rate=15.0)):.4f} J")
    107.4425 J
    """

    rod: Rod | Lumped
    motion: AbstractMotion
    basis: Ritz
    gravity: Float[Array, ""] | None
    forces: tuple[AbstractForce, ...]

    def __init__(self, rod, motion, basis=None, gravity=None, forces=()):
        self.rod, self.motion = rod, motion
        self.basis = Ritz(1) if basis is None else basis
        self.gravity = None if gravity is None else checks.not_negative("gravity", gravity, "m/s^2, or None")
        if not isinstance(forces, tuple | list):
            raise ValueError(f"forces={forces!r} is not a sequence of forces; give a tuple such as (Torque(1.0),).")
        self.forces = tuple(forces)
        for name, value, kind in (
            ("rod", rod, Rod | Lumped),
            ("motion", motion, AbstractMotion),
            ("basis", self.basis, Ritz),
        ):
            if not isinstance(value, kind):
                raise ValueError(f"{name}={value!r} is not a {name}; give an instance such as {_EXAMPLES[name]}.")
        for force in self.forces:
            if not isinstance(force, AbstractForce):
                raise ValueError(
                    f"forces holds {force!r}, which is not a force; give Torque, PivotFriction or your own."
                )
            force.check(motion)
        self._check_support()

    def _check_support(self):
        if isinstance(self.rod, Lumped):
            if isinstance(self.motion, Flight):
                raise ValueError("rod=Lumped(...) is a pivoted body without a mass; for Flight() give a Rod.")
            if isinstance(self.motion, AbstractPivoted) and checks.fails(lambda x: x == 0, self.motion.pivot):
                raise ValueError("rod=Lumped(...) is given about its pivot already; leave out pivot=.")
        elif isinstance(self.motion, AbstractPivoted):
            pivot, length = self.motion.pivot, self.rod.length
            if checks.fails(np.less_equal, pivot, length):
                raise ValueError(
                    f"pivot={checks.shown(pivot)} lies beyond the rod; it must be within length={checks.shown(length)} m."
                )
            if checks.fails(lambda area: area > 0, self.rod.area(pivot)):
                raise ValueError(
                    f"pivot={checks.shown(pivot)} m is where the section vanishes, and a pin at a point holds nothing; "
                    "move the pivot or give the end a radius."
                )

    # ---- the rod as the basis sees it

    @property
    def origin(self) -> Float[Array, ""]:
        """Material coordinate in m that stays put: the pivot, in flight the centre of mass."""
        return self.motion.pivot if isinstance(self.motion, AbstractPivoted) else _whole(self.rod).center_of_mass

    @property
    def body(self) -> Projection:
        """Mass matrix, stiffness matrix and first moments about `origin`."""
        return self.basis.project(self.rod, self.origin)

    # ---- states

    def state(
        self, *, angle=0.0, rate=0.0, strain=0.0, strain_rate=0.0, azimuth=None, azimuth_rate=None, center=None,
        center_velocity=None,
    ) -> State:  # fmt: skip
        """A state of this scene.

        **Arguments:** `angle` above the horizontal (rad) and its `rate` (rad/s); uniform `strain` (> -1) and
        `strain_rate` (1/s); for `Spherical`, `azimuth` (rad) and `azimuth_rate` (rad/s); for `Flight`, `center` (m) and
        `center_velocity` (m/s) of the centre of mass, two numbers each.

        **Raises:** `ValueError` for non-finite numbers, strain <= -1, strain of a rigid rod, and arguments that this
        motion does not have.
        """
        space, flight = self.motion.dimension == 3, isinstance(self.motion, Flight)
        for name, value, needed in (
            ("azimuth", azimuth, "Spherical()" if not space else ""),
            ("azimuth_rate", azimuth_rate, "Spherical()" if not space else ""),
            ("center", center, "Flight()" if not flight else ""),
            ("center_velocity", center_velocity, "Flight()" if not flight else ""),
        ):
            if value is not None and needed:
                kind = type(self.motion).__name__
                raise ValueError(f"{name}={value!r} has no meaning for {kind}(); leave it out or take motion={needed}.")
        numbers = {"angle": angle, "rate": rate, "strain": strain, "strain_rate": strain_rate}
        if space:
            numbers |= {"azimuth": _or_zero(azimuth), "azimuth_rate": _or_zero(azimuth_rate)}
        given = {name: checks.number(name, value) for name, value in numbers.items()}
        self._check_strain(given)
        place = {"center": center, "center_velocity": center_velocity} if flight else {}
        place = {name: checks.number(name, _or_zero(value, (0.0, 0.0)), (2,)) for name, value in place.items()}

        dtype = checks.float_type(self, given, place)
        given, place = jax.tree.map(lambda x: x.astype(dtype), (given, place))
        direction, direction_rate = (_spatial if space else _planar)(**given)
        turns = (given["azimuth" if space else "angle"] - heading(direction)) / (2 * jnp.pi)
        return State(
            direction,
            direction_rate,
            given["strain"][None][: self.basis.n],
            given["strain_rate"][None][: self.basis.n],
            jax.lax.stop_gradient(jnp.round(turns)),
            **place,
        )

    def _check_strain(self, given):
        strain, rate = given["strain"], given["strain_rate"]
        if self.basis.n == 0 and any(checks.fails(lambda x: x == 0, x) for x in (strain, rate)):
            raise ValueError(
                f"strain={checks.shown(strain)}, strain_rate={checks.shown(rate)}: Ritz(0) is rigid; take Ritz(1) or "
                "leave them out."
            )
        if checks.fails(lambda strain: strain > -1, strain):
            raise ValueError(f"strain={checks.shown(strain)} turns the rod inside out; it must be above -1.")

    def valid(self, start: State) -> Array:
        """Whether rod and start make sense: what construction asks of known numbers, for traced ones."""
        finite = [jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(eqx.filter((self, start), eqx.is_inexact_array))]
        valid = self.rod.valid() & jnp.all(jnp.stack(finite)) & jnp.all(start.amplitudes > -1)
        if isinstance(self.motion, AbstractPivoted):
            valid = valid & (self.motion.pivot >= 0) & (self.motion.pivot <= self.rod.length)
        return valid

    # ---- energies of a state, in J

    def kinetic_energy(self, state: State) -> Float[Array, ""]:
        """Kinetic energy T of one state."""
        turning = energy.kinetic_director(self.body, state.amplitudes, state.amplitude_rates, state.direction_rate)
        if state.center_velocity is None:
            return turning
        return turning + energy.kinetic_center(_whole(self.rod).mass, state.center_velocity)

    def elastic_energy(self, state: State) -> Float[Array, ""]:
        """Strain energy of one state."""
        return energy.elastic(self.body, state.amplitudes)

    def gravity_energy(self, state: State) -> Float[Array, ""]:
        """Energy of weight of one state: zero at the pivot, in flight at the origin."""
        if self.gravity is None:
            return jnp.zeros_like(state.turns)
        place = Placement(state.direction, state.amplitudes, state.center)
        return _weight(self.body, self._flying_mass(), self.gravity, place)

    def energy(self, state: State) -> Float[Array, ""]:
        """T + V of one state, V = 0 at the pivot (in flight at the origin)."""
        return self.kinetic_energy(state) + self.elastic_energy(state) + self.gravity_energy(state)

    # ---- other quantities of a state

    def angular_momentum(self, state: State) -> Float[Array, ""] | Float[Array, " 3"]:
        """Angular momentum about the pivot (in flight the centre of mass) in kg m^2/s: in space a vector."""
        inertia = self.body.inertia(state.amplitudes)
        if state.planar:
            return inertia * state.rate
        return inertia * jnp.cross(state.direction, state.direction_rate)

    def shape(self, state: State, s: Float[Array, " points"]) -> Float[Array, "points D"]:
        """Positions in m of the material points s (m): from the pivot, in flight from the origin."""
        phi = self.basis.shapes(jnp.asarray(s), self.origin)
        along = phi[0] + state.amplitudes @ phi[1:]
        points = along[:, None] * state.direction[None, :]
        return points if state.center is None else points + state.center[None, :]

    def tip(self, state: State) -> Float[Array, " D"]:
        """Position of the tip in m."""
        return self.shape(state, self.rod.length[None])[0]

    # ---- equations of motion

    def lagrangian(self, chart: AbstractChart) -> Lagrangian:
        """The Lagrangian of this scene in the coordinates of `chart`, with its generalized forces."""
        force = _GeneralizedForce(self, chart) if self.forces else None
        return Lagrangian(_RodLagrangian(self, chart, self.body, self._flying_mass()), force)

    def _flying_mass(self) -> Float[Array, ""] | None:
        return _whole(self.rod).mass if isinstance(self.motion, Flight) else None


class _RodLagrangian(eqx.Module):
    """L = T - V.  A module, not a closure: the projected rod is computed once and stays out of the time loop."""

    system: System
    chart: AbstractChart
    body: Projection
    mass: Float[Array, ""] | None

    def __call__(self, t, q, v):
        del t
        motion = self.system.motion
        place = self.chart.place(motion, q)
        kinetic = self.chart.kinetic(motion, self.body, q, v)
        if self.mass is not None:
            kinetic = kinetic + energy.kinetic_center(self.mass, v[-motion.dimension :])
        potential = energy.elastic(self.body, place.amplitudes)
        if self.system.gravity is not None:
            potential = potential + _weight(self.body, self.mass, self.system.gravity, place)
        return kinetic - potential


class _GeneralizedForce(eqx.Module):
    """Q = dP/dv of the virtual power P of all forces."""

    system: System
    chart: AbstractChart

    def __call__(self, t, q, v):
        motion = self.system.motion
        state = self.chart.decode(motion, q, v)

        def power(virtual_v):
            _, virtual = jax.jvp(lambda q: self.chart.place(motion, q), (q,), (virtual_v,))
            return sum((force.power(t, state, virtual) for force in self.system.forces), jnp.zeros_like(q[0]))

        return jax.grad(power)(jnp.zeros_like(v))


def _weight(body: Projection, mass, gravity, place: Placement) -> Float[Array, ""]:
    if place.center is None:
        return energy.gravity_pivoted(body, gravity, place.amplitudes, place.direction)
    return energy.gravity_center(mass, gravity, place.center)


_EXAMPLES = {"rod": "Rod(length, section, young, density)", "motion": "Rotation()", "basis": "Ritz(1)"}


def _whole(rod: Rod | Lumped) -> Rod:
    """The rod, where only one with a mass can be: construction has seen to that."""
    assert isinstance(rod, Rod)
    return rod


def _or_zero(value, zero: Any = 0.0):
    return zero if value is None else value


def _planar(angle, rate, **_):
    direction = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    return direction, rate * jnp.stack([-direction[1], direction[0]])


def _spatial(angle, rate, azimuth, azimuth_rate, **_):
    outward = jnp.stack([jnp.cos(azimuth), jnp.sin(azimuth), jnp.zeros_like(azimuth)])
    sideways = jnp.stack([-outward[1], outward[0], outward[2]])
    up = jnp.zeros_like(outward).at[2].set(1.0)
    direction = jnp.cos(angle) * outward + jnp.sin(angle) * up
    elevating = jnp.cos(angle) * up - jnp.sin(angle) * outward
    return direction, rate * elevating + azimuth_rate * jnp.cos(angle) * sideways
