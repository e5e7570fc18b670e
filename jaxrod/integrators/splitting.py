"""What solvers of equal steps ask of the equations that they step.  Knows no rods.

A *split* has a drift, the motion without loads, and a kick, the loads at a frozen position.  `encode` and `decode` are of
one scene; all else is of laned arrays (`core/lanes.py`), the split's own and those of a phase.
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class PhasePoint(NamedTuple):
    """What moves: q and its momentum p; where q is the director alone the strain and its momentum.

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


class AbstractStepper(eqx.Module):
    """A scene that goes by equal steps."""

    has_past: ClassVar[bool] = False  # whether its phase remembers, while it is opened, where it was steps before

    @abc.abstractmethod
    def encode(self, state: Any) -> PhasePoint:
        """The numbers of a state."""

    @abc.abstractmethod
    def decode(self, t, y: PhasePoint, turns) -> Any:
        """The state at time t."""

    @abc.abstractmethod
    def table(self, scheme, h) -> Any:
        """What is known of steps of size h by `scheme`, once for all of them; it carries no derivative.

        None, or of each stage, in rows, and of the first drift.
        """

    @abc.abstractmethod
    def step(self, scheme, table, t, h, y: Any) -> Any:
        """One step from time t, between phases as `enter` makes them."""

    def enter(self, scheme, table, t, h, y: PhasePoint) -> Any:
        """The phase that steps of size h begin with at time t."""
        del scheme, table, t, h
        return y

    def leave(self, scheme, table, t, h, y: Any) -> PhasePoint:
        """Undoes `enter`."""
        del scheme, table, t, h
        return y

    def longest_step(self, scheme, spin: Float[Array, ""]) -> Any:
        """The step in s beyond which the method is unstable or cannot see the motion, which spins with at most `spin` rad/s
        if it is driven.

        inf where no closed form says so: then only the motion itself shows it.
        """
        del scheme, spin
        return jnp.inf

    def whole_step(self, scheme, table, t, h, y: PhasePoint) -> PhasePoint:
        """A step from y to y."""
        y = self.step(scheme, table, t, h, self.enter(scheme, table, t, h, y))
        return self.leave(scheme, table, t + h, h, y)

    def undoable(self, scheme) -> "tuple[Any, AbstractSplitting]":
        """Scheme and scene by which the reverse derivative goes back: these, if their stages can be undone."""
        assert isinstance(self, AbstractSplitting)
        return scheme, self

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


class AbstractSplitting(AbstractStepper):
    """A scene as drift and kick: its steps are stages that can be undone one by one."""

    @abc.abstractmethod
    def stage(self, stage: Stage, known, t, h, y: PhasePoint) -> PhasePoint:
        """A kick and the drift to the next one, in a step of size h from time t; `known` is the table's row."""

    @abc.abstractmethod
    def inverse_stage(self, stage: Stage, known, t, h, y: PhasePoint) -> PhasePoint:
        """The normalized y before that stage."""

    def normalized(self, y: PhasePoint) -> PhasePoint:
        """The same phase, in its one form that leaves nothing to be done."""
        return y

    def scan_stages(self, scheme, table, visit: Callable, carry, backwards: bool = False) -> Any:
        """The carry after `visit(carry, stage, known)` at each stage of a step.

        In a scan: XLA takes several times as long to compile stages written out, which are no faster.
        """
        dtype = jax.tree.leaves(carry)[0].dtype
        stages = Stage(*(jnp.asarray(x, dtype) for x in zip(*scheme.stages, strict=True)))
        rows = (stages, None if table is None else table[0])
        return jax.lax.scan(lambda carry, row: (visit(carry, *row), None), carry, rows, reverse=backwards)[0]

    def step(self, scheme, table, t, h, y):
        def ahead(y, stage, known):
            return self.stage(stage, known, t, h, y)

        return self.scan_stages(scheme, table, ahead, y)
