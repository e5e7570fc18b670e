"""Axial modes of a rod that is turned as prescribed."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...core.scalarize import by_number, gathered, scattered
from ...integrators.splitting import Split
from ...motions.state import State
from ..chart import Strains
from ..equations import DiscreteSystem, Moving
from .common import LONGEST_TURN, watched
from .normal_modes import AbstractOscillating, AxialModes, back


class Prescribed(AbstractOscillating):
    """A `Driven` rotation: exact oscillators, kicked by the centrifugal pull and by gravity of the moment."""

    scene: DiscreteSystem  # without its stiffness, which the oscillators have
    modes: AxialModes
    numbers: Any
    field: Any

    def __init__(self, scene: DiscreteSystem, t0, start: State):
        del t0, start
        self.modes = AxialModes(scene.body)
        slack = eqx.tree_at(lambda s: s.body.stiffness_matrix, scene, jnp.zeros_like(scene.body.stiffness_matrix))
        self.scene = slack
        self.numbers = scattered((self.modes, slack))
        self.field = scattered(self.modes.shapes.T @ watched(scene.body.strains))

    def encode(self, state):
        eta, deta = self.modes.encode(state)
        return Split(None, None, scattered(eta), scattered(deta))

    def decode(self, t, y, turns):
        eta, deta = gathered((y.strain, y.strain_momentum))
        return Strains().decode(self.scene.motion, t, *self.modes.decode(eta, deta), turns)

    def stage(self, stage, known, t, h, y):
        return self._drift(known, stage.drift * h, self._kick(t + stage.passed * h, stage.kick * h, y))

    def undone(self, stage, known, t, h, y):
        return self._kick(t + stage.passed * h, -stage.kick * h, self._drift(back(known), -stage.drift * h, y))

    def longest_step(self, scheme, ts):
        # Exact oscillators are always stable, but gravity and a drive that turn further in a step are not seen.
        del scheme
        motion: Any = self.scene.motion
        fastest = jnp.max(jnp.abs(jax.vmap(lambda t: motion.turning(t)[1])(ts)))
        return jnp.minimum(math.pi / self.modes.rates[0], LONGEST_TURN / jnp.maximum(fastest, 1e-30))

    def _drift(self, circle, t, y: Split):
        pairs = list(zip(self._turned(circle, t), y.strain, y.strain_momentum, strict=True))
        return y._replace(
            strain=y.strain.like([x + (s * p - v * x) for (v, s), x, p in pairs]),
            strain_momentum=y.strain.like([p - (s * x + v * p) for (v, s), x, p in pairs]),
        )

    def _kick(self, t, h, y: Split):
        modes, scene = self.numbers
        return self._kicked(h, by_number(_push)(modes, scene, t, y.strain), y)


def _push(modes: AxialModes, scene: DiscreteSystem, t, eta):
    equations = Moving(scene, Strains())
    amplitudes = modes.shapes @ eta
    still = jnp.zeros_like(amplitudes)
    push = jax.grad(equations.function, argnums=1)(t, amplitudes, still)
    if scene.forces:
        push = push + equations.force(t, amplitudes, still)
    return modes.shapes.T @ push / scene.body.mass_matrix[0, 0]
