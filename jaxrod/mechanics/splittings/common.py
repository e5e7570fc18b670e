"""The equations of motion cut into flows that are known exactly.

A split has a *drift*, the motion without loads, and a *kick*, the loads at a frozen position, which is minus a gradient
that automatic differentiation takes from the energies.  Symmetric compositions of the two (`symplectic.py`) are methods
of high order that keep the energy without a trend.

Everything is per unit of the moment of inertia at rest, and number by number (`lanes.py`): a phase is a pytree of scalars,
which become vectors of lanes under `vmap`.
"""

import abc
import functools
import math
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...core.scalarize import Numbers, by_number
from ...motions.motion import Flight, Rotation, State
from ...shapes.projection import Projection
from ..equations import Scene

LONGEST_TURN = math.pi / 4  # rad in a step: beyond it the rod is not seen to turn


class Split(NamedTuple):
    """What moves: q and its momentum p; where q is the director alone the strain and its momentum; `Numbers` all.

    `turning`: int 1/J dt by which the director is behind.
    """

    q: Any
    p: Any
    strain: Any = None
    strain_momentum: Any = None
    turning: Any = None


class Stage(NamedTuple):
    """Fractions of a step: the time passed, the kick then in two parts, and the drift after it.

    `before` is the second half of a first-order step and `after` the first half of another, backwards: a kick of parts that
    do not commute goes through them in one order for the one, in the other for the other (McLachlan 1995).
    """

    passed: Any
    before: Any
    after: Any
    drift: Any

    @property
    def kick(self):
        """The whole kick."""
        return self.before + self.after


class AbstractStepped(eqx.Module):
    """A scene that goes by equal steps."""

    has_past: ClassVar[bool] = False  # whether its phase remembers, while it is opened, where it was steps before

    @abc.abstractmethod
    def encode(self, state: State) -> Split:
        """The numbers of a state."""

    @abc.abstractmethod
    def decode(self, t, y: Split, turns) -> State:
        """The state at time t."""

    @abc.abstractmethod
    def table(self, scheme, h) -> Any:
        """What is known of steps of size h by `scheme`, once for all of them; it carries no derivative."""

    @abc.abstractmethod
    def step(self, scheme, table, t, h, y: Any) -> Any:
        """One step from time t, between phases as `opened` makes them."""

    def opened(self, scheme, table, t, h, y: Split) -> Any:
        """The phase that steps of size h begin with at time t."""
        del scheme, table, t, h
        return y

    def closed(self, scheme, table, t, h, y: Any) -> Split:
        """Undoes `opened`."""
        del scheme, table, t, h
        return y

    def longest_step(self, scheme, ts: Float[Array, " T"]) -> Any:
        """The step in s beyond which the method is unstable or cannot see the motion, in a run that saves at `ts`.

        inf where no closed form says so: then only the motion itself shows it.
        """
        del scheme, ts
        return jnp.inf

    def whole_step(self, scheme, table, t, h, y: Split) -> Split:
        """A step from y to y."""
        y = self.step(scheme, table, t, h, self.opened(scheme, table, t, h, y))
        return self.closed(scheme, table, t + h, h, y)

    def steps_at_once(self, scheme) -> int:
        """How many steps are written out one after the other, and stopped together."""
        del scheme
        return 1

    def heading(self, y: Any) -> Any:
        """Coordinates along the director, whose turns are to be counted; None if there are none."""
        return y.q

    @abc.abstractmethod
    def lowest_strain(self, phases: list) -> Float[Array, ""]:
        """The least strain along the rod in any of them."""


class AbstractSplit(AbstractStepped):
    """A scene as drift and kick: its steps are stages that can be undone one by one."""

    @abc.abstractmethod
    def stage(self, stage: Stage, known, t, h, y: Split) -> Split:
        """A kick and the drift to the next one, in a step of size h from time t; `known` is the table's row."""

    @abc.abstractmethod
    def undone(self, stage: Stage, known, t, h, y: Split) -> Split:
        """The settled y before that stage."""

    def settled(self, y: Split) -> Split:
        """The same phase, in its one form that leaves nothing to be done."""
        return y

    @abc.abstractmethod
    def through(self, scheme, table, visit: Callable, carry, backwards: bool = False) -> Any:
        """The carry after `visit(carry, stage, known)` at each stage of a step."""

    def step(self, scheme, table, t, h, y):
        def ahead(y, stage, known):
            return self.stage(stage, known, t, h, y)

        return self.through(scheme, table, ahead, y)


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
    def of(scene: Scene, t0, start: State) -> "Center | None":
        """That of a flight, else None."""
        if not isinstance(scene.motion, Flight):
            return None
        assert start.center is not None and start.center_velocity is not None
        down = jnp.zeros_like(start.center)
        if scene.gravity is not None:
            down = down.at[-1].set(-scene.gravity) if scene.gravity.ndim == 0 else scene.gravity
        return Center(t0, start.center, start.center_velocity, down)


def watched(field: Float[Array, "n points"]) -> Float[Array, "n places"]:
    """A field along the rod at 2 n + 3 of its points: each step looks there whether the rod collapses."""
    n, points = field.shape
    return field[:, np.unique(np.linspace(0, points - 1, 2 * n + 3).round().astype(int))]


def least(numbers: Iterable) -> Any:
    """The least of several numbers, lane by lane."""
    return functools.reduce(jnp.minimum, numbers)


def lowest(amplitudes: Numbers, field: Numbers) -> Any:
    """The least strain at the points where `field` is known."""
    return least(by_number(jnp.matmul)(amplitudes, field))


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


def held(scene: Scene, body: Projection) -> Scene:
    """The scene of the turning alone: in flight about the centre of mass, where nothing weighs."""
    if isinstance(scene.motion, Flight):
        return Scene(Rotation(), body, None, scene.forces)
    return Scene(scene.motion, body, scene.gravity, scene.forces)


def without_center(state: State) -> State:
    return State(state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates, state.turns)


def with_center(state: State, center: Center | None, t) -> State:
    if center is None:
        return state
    position, velocity = center(t)
    return State(
        state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates, state.turns, position, velocity
    )
