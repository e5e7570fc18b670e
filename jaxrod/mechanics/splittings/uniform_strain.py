"""Uniform strain, where the kinetic energy is that of a mass point: a mass on a spring."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core.each_lane import lanewise
from ...core.lanes import summed
from ...integrators.splitting import AbstractSplitting, PhasePoint
from ...motions.state import State
from .. import energy
from ..chart import Embedded
from ..equations import DiscreteSystem, Moving
from .common import Center, held, per_inertia, with_center, without_center


class UniformStrainSplitting(AbstractSplitting):
    """Uniform strain in q = (1 + eps) d: a mass on a spring.  Drift: straight on.  Kick: the gradient of all of V."""

    scene: DiscreteSystem
    lean: DiscreteSystem  # per inertia, without forces
    loads: DiscreteSystem | None  # the scene, if it has forces
    center: Center | None

    def __init__(self, scene: DiscreteSystem, t0, start: State):
        self.center = Center.of(scene, t0, start)
        body = per_inertia(scene.body)
        rigidity = jnp.sum(body.rigidity, keepdims=True)
        lean = eqx.tree_at(lambda b: (b.strains, b.rigidity), body, (jnp.ones_like(rigidity)[None], rigidity))
        self.scene = held(scene, scene.body)
        self.loads = self.scene if scene.forces else None
        self.lean = dataclasses.replace(self.scene, body=lean, forces=())

    def encode(self, state):
        q, v = Embedded().encode(self.scene.motion, without_center(state))
        return PhasePoint(q, v)

    def decode(self, t, y, turns):
        return with_center(Embedded().decode(self.scene.motion, t, y.q, y.p, turns), self.center, t)

    def table(self, scheme, h):
        return None

    def stage(self, stage, known, t, h, y):
        del known
        v = y.p + stage.kick * h * self.force(t + stage.passed * h, y.q)
        return PhasePoint(y.q + stage.drift * h * v, v)

    def inverse_stage(self, stage, known, t, h, y):
        del known
        q = y.q - stage.drift * h * y.p
        return PhasePoint(q, y.p - stage.kick * h * self.force(t + stage.passed * h, q))

    def enter(self, scheme, table, t, h, y):
        del table, t
        return PhasePoint(y.q + scheme.drifts[0] * h * y.p, y.p)

    def leave(self, scheme, table, t, h, y):
        return self.enter(scheme, table, t, -h, y)

    def longest_step(self, scheme, spin):
        del spin
        return scheme.stable_phase / jnp.sqrt(self.lean.body.stiffness_matrix[0, 0])

    def force(self, t, q: Float[Array, "D lanes"]) -> Float[Array, "D lanes"]:
        """All loads on q, per inertia: minus the gradient of V, and those without a potential."""
        return lanewise(_force)(self.lean, self.loads, t, q)

    def lowest_strain(self, phases):
        squares = [summed(y.q * y.q) for y in phases]
        return jnp.sqrt(functools.reduce(jnp.minimum, squares)) - 1


def _force(scene: DiscreteSystem, loads: DiscreteSystem | None, t, q):
    push = -jax.grad(_embedded_potential, argnums=1)(scene, q)
    if loads is None:
        return push
    return push + Moving(loads, Embedded()).force(t, q, jnp.zeros_like(q)) / loads.body.mass_matrix[0, 0]


def _embedded_potential(scene: DiscreteSystem, q):
    strain = energy.elastic_embedded(scene.body, q)
    return strain if scene.gravity is None else strain + energy.gravity_embedded(scene.body, scene.gravity, q)
