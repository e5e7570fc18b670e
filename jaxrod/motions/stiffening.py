"""Forces that push on the strain in proportion to it, such as a spring at the tip: they change the axial frequencies."""

import dataclasses
import warnings
from typing import Any

import jax
import jax.numpy as jnp

from ..core import tracing, validation
from ..core.tracing import depends_on_first
from ..shapes.basis import Ritz
from .state import State

_LEAST = 1e-9  # stiffness of the forces, over that of the rod, that is worth a warning


def warn_of_forces(name: str, system: Any) -> None:
    """Warn that `name` leaves out forces that stiffen or soften this scene; silent under transformations."""
    if not getattr(system, "forces", ()) or not all(map(tracing.known, jax.tree.leaves(system))):
        return
    system = system if system.basis.n else dataclasses.replace(system, basis=Ritz(1))
    # A look at the program comes first: it costs no compilation.
    if depends_on_first(_pushes(system), jnp.zeros(system.basis.n)) and validation.fails(
        lambda x: x < _LEAST, _share(system)
    ):
        warnings.warn(
            f"{name} leaves out the forces of this scene, which change its axial stiffness; jaxrod.modes(system) takes "
            "them into account.",
            stacklevel=3,
        )


@tracing.run_seldom
def _share(system):
    """Stiffness of the forces over that of the rod."""
    stiffness = jax.jacfwd(_pushes(system))(jnp.zeros(system.basis.n))
    return jnp.max(jnp.abs(stiffness)) / jnp.max(jnp.abs(system.body.stiffness_matrix))


def _pushes(system):
    """Generalized forces on the strain as a function of it, at rest at t = 0: level and hanging."""
    size, zero = system.motion.dimension, jnp.zeros(())
    still, center = jnp.zeros(size), jnp.zeros(size) if system.motion.flies else None

    def pushes(amplitudes):
        def power(rates, direction):
            return system.power(zero, State(direction, still, amplitudes, rates, zero, center, center))

        return [jax.grad(power)(jnp.zeros_like(amplitudes), d) for d in (still.at[0].set(1.0), still.at[-1].set(-1.0))]

    return lambda amplitudes: jnp.stack(pushes(amplitudes))
