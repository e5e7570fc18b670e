"""Natural frequencies of a scene, and how far they are from the exact rod's."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from . import continuum
from .system import System


def natural_frequencies(system: System) -> Float[Array, " n"]:
    """Axial natural frequencies in Hz, ascending, at rest and without gravity: one for each strain shape.

    For uniform strain sqrt(c l0^2 / I) / 2 pi; a rigid rod has none.  Differentiable in every number of the rod.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation())).round(3))
    [22.972]
    """
    body = system.body
    # With at most one shape both matrices are diagonal.
    square = jnp.diagonal(body.stiffness_matrix) / jnp.diagonal(body.strain_mass)
    return jnp.sqrt(square) / (2 * jnp.pi)


def frequency_error(system: System) -> Float[Array, " n"]:
    """Error of `natural_frequencies` against the exact rod, in percent.

    >>> import jaxrod
    >>> uniform = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.frequency_error(jaxrod.System(uniform, jaxrod.Rotation())).round(2))
    [10.27]
    """
    frequencies = natural_frequencies(system)
    return 100 * (frequencies / continuum.natural_frequencies(system, frequencies.shape[0]) - 1)
