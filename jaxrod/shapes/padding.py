"""Several rungs of one family in arrays of one size: one compiled program serves them all."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..rods.lumped import Lumped
from ..rods.quadrature import Panels
from ..rods.rod import Rod
from .basis import AbstractBasis, AbstractShapesOf
from .projection import Projection


class FirstShapes(AbstractShapesOf):
    """The first `kept` shapes of a `basis` that contains its smaller ones, in arrays of all n of them.

    The others carry no load and are coupled with nothing: at rest they stay at rest.  They vibrate as fast as the stiffest that
    is kept, so that no step is shorter for them.
    """

    basis: AbstractBasis
    kept: Int[Array, ""]

    def __init__(self, basis: AbstractBasis, kept: Any):
        self.basis, self.kept = basis, jnp.asarray(kept, jnp.int32)

    @property
    def uniform(self):
        return False

    def strains(self, rod: Rod, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False):
        return jnp.where(self._known[:, None], super().strains(rod, s, pivot, free), 0.0)

    def nodal(self, rod: Rod, panels: Panels, pivot: Float[Array, ""] | None, free: bool):
        return jnp.where(self._known[:, None], super().nodal(rod, panels, pivot, free), 0.0)

    def project(self, rod: Rod | Lumped, pivot: Float[Array, ""] | None = None, free: bool = False) -> Projection:
        body, known = super().project(rod, pivot, free), self._known
        mass, stiffness = jnp.diagonal(body.strain_mass), jnp.diagonal(body.stiffness_matrix)
        fastest = jax.lax.stop_gradient(jnp.max(jnp.where(known, stiffness / jnp.where(known, mass, 1.0), 0.0)))
        # Of the mass that the root of the mass matrix has for shapes without any.
        idle = jnp.where(known, 0.0, mass[0])
        masses = body.mass_matrix + jnp.diag(jnp.concatenate([jnp.zeros(1, idle.dtype), idle]))
        stiffnesses = body.stiffness_matrix + jnp.diag(jnp.where(known, 0.0, mass[0] * fastest - stiffness))
        return dataclasses.replace(body, mass_matrix=masses, stiffness_matrix=stiffnesses)

    @property
    def _known(self):
        return jnp.arange(self.n) < self.kept
