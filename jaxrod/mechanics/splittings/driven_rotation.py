"""Axial modes of a rod that is turned as prescribed."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core.each_lane import lanewise
from ...integrators.splitting import PhasePoint
from ...motions.state import State
from ..chart import Strains
from ..equations import DiscreteSystem, Moving
from .common import LONGEST_TURN, watched
from .normal_modes import AbstractModalSplitting, AxialModes, back


class DrivenRotationSplitting(AbstractModalSplitting):
    """A `Driven` rotation: exact oscillators, kicked by the centrifugal pull and by gravity of the moment."""

    scene: DiscreteSystem  # without its stiffness, which the oscillators have
    modes: AxialModes
    field: Float[Array, "n places"]

    def __init__(self, scene: DiscreteSystem, t0, start: State):
        del t0, start
        self.modes = AxialModes(scene.body)
        self.scene = eqx.tree_at(lambda s: s.body.stiffness_matrix, scene, jnp.zeros_like(scene.body.stiffness_matrix))
        self.field = self.modes.shapes.T @ watched(scene.body.strains)

    def encode(self, state):
        eta, deta = self.modes.encode(state)
        return PhasePoint(None, None, eta, deta)

    def decode(self, t, y, turns):
        return Strains().decode(self.scene.motion, t, *self.modes.decode(y.strain, y.strain_momentum), turns)

    def stage(self, stage, known, t, h, y):
        return self._drift(known, stage.drift * h, self._kick(t + stage.passed * h, stage.kick * h, y))

    def inverse_stage(self, stage, known, t, h, y):
        return self._kick(t + stage.passed * h, -stage.kick * h, self._drift(back(known), -stage.drift * h, y))

    def longest_step(self, scheme, spin):
        # Exact oscillators are always stable, but gravity and a drive that turn further in a step are not seen.
        del scheme
        return jnp.minimum(math.pi / self.modes.rates[0], LONGEST_TURN / jnp.maximum(spin, 1e-30))

    def _drift(self, circle, t, y: PhasePoint):
        (versine, sin), x, p = self._turned(circle, t), y.strain, y.strain_momentum
        return y._replace(strain=x + (sin * p - versine * x), strain_momentum=p - (sin * x + versine * p))

    def _kick(self, t, h, y: PhasePoint):
        return self._kicked(h, lanewise(_push)(self.modes, self.scene, t, y.strain), y)


def _push(modes: AxialModes, scene: DiscreteSystem, t, eta):
    equations = Moving(scene, Strains())
    amplitudes = modes.shapes @ eta
    still = jnp.zeros_like(amplitudes)
    push = jax.grad(equations.function, argnums=1)(t, amplitudes, still)
    if scene.forces:
        push = push + equations.force(t, amplitudes, still)
    return modes.shapes.T @ push / scene.body.mass_matrix[0, 0]
