"""Uniform strain stepped by a symmetric multistep method, which remembers where it was."""

import itertools
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...integrators.multistep import STARTER, SUBSTEPS, AbstractMultistep
from ...integrators.splitting import AbstractStepper, PhasePoint
from .uniform_strain import UniformStrainSplitting


class Past(NamedTuple):
    """The newest position; differences of positions and accelerations, the newest first."""

    q: Float[Array, "D lanes"]
    differences: tuple[Float[Array, "D lanes"], ...]
    accelerations: tuple[Float[Array, "D lanes"], ...]


class MultistepStepper(AbstractStepper):
    """Uniform strain with its past."""

    has_past: ClassVar = True
    flat: UniformStrainSplitting

    def undoable(self, scheme):
        return STARTER, self.flat  # in as many steps, each of several stages: as exact where this method is stable

    def steps_at_once(self, scheme):
        return scheme.past  # after so many each part of the past is at its old place, and nothing was copied

    def encode(self, state):
        return self.flat.encode(state)

    def decode(self, t, y, turns):
        return self.flat.decode(t, y, turns)

    def table(self, scheme, h):
        del scheme, h

    def enter(self, scheme: AbstractMultistep, table, t, h, y):
        """Runs back for a past, by short steps of another method."""
        back = -h / SUBSTEPS
        positions, accelerations = [y.q], [self.flat.force(t, y.q)]
        for k in range(scheme.past):
            for j in range(SUBSTEPS):
                y = self.flat.whole_step(STARTER, None, t + (k * SUBSTEPS + j) * back, back, y)
            positions.append(y.q)
            accelerations.append(self.flat.force(t - (k + 1) * h, y.q))
        differences = tuple(here - before for here, before in itertools.pairwise(positions))
        return Past(positions[0], differences, tuple(accelerations[:-1]))

    def leave(self, scheme: AbstractMultistep, table, t, h, y):
        """Position and velocity now."""
        velocity = y.differences[0] / h
        for weight, acceleration in zip(scheme.velocity, y.accelerations, strict=True):
            velocity = velocity + weight * h * acceleration
        return PhasePoint(y.q, velocity)

    def step(self, scheme: AbstractMultistep, table, t, h, y):
        weights, half, past = scheme.weights, scheme.past // 2, y.accelerations
        push = weights[half] * past[half]
        for weight, newer, older in zip(weights[:half], past, reversed(past), strict=False):
            push = push + weight * (newer + older)
        ahead = h * h * push
        for weight, difference in zip(scheme.differences, y.differences, strict=True):
            ahead = ahead + float(weight) * difference if weight else ahead
        q = y.q + ahead
        return Past(q, (ahead, *y.differences[:-1]), (self.flat.force(t + h, q), *y.accelerations[:-1]))

    def longest_step(self, scheme: AbstractMultistep, spin):
        del spin
        return scheme.stable_phase / jnp.sqrt(self.flat.lean.body.stiffness_matrix[0, 0])

    def lowest_strain(self, phases):
        return self.flat.lowest_strain(phases)
