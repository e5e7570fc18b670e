"""Natural frequencies of a scene, and how far they are from the exact rod's."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from . import continuum, spectrum
from .system import System


def natural_frequencies(system: System) -> Float[Array, " n"]:
    """Axial natural frequencies in Hz, ascending, at rest and without gravity: one for each strain shape.

    For uniform strain sqrt(c l0^2 / I) / 2 pi; a rigid rod has none.  Shapes on a piece of no length, where the pivot
    lies on an end, have inf.  Differentiable in every number of the rod.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation())).round(3))
    [22.972]
    >>> print(jaxrod.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation(), jaxrod.Ritz(3))).round(3))
    [ 19.239  68.212 158.86 ]
    """
    body = system.body
    if system.basis.n < 2:
        square = jnp.diagonal(body.stiffness_matrix) / jnp.diagonal(body.strain_mass)
        return jnp.sqrt(square) / (2 * jnp.pi)
    # M v = K v / omega^2: the lowest frequencies, the largest 1 / omega^2, come out best.
    compliance, _ = spectrum.eigh(body.strain_mass, body.stiffness_matrix)
    rigid = compliance <= jnp.finfo(compliance.dtype).eps * compliance[-1] / 8
    return jnp.where(rigid, jnp.inf, 1 / jnp.sqrt(jnp.where(rigid, 1.0, compliance)))[::-1] / (2 * jnp.pi)


def frequency_error(system: System) -> Float[Array, " n"]:
    """Error of `natural_frequencies` against the exact rod, in percent.

    >>> import jaxrod
    >>> uniform = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.frequency_error(jaxrod.System(uniform, jaxrod.Rotation())).round(2))
    [10.27]
    """
    frequencies = natural_frequencies(system)
    return 100 * (frequencies / continuum.natural_frequencies(system, frequencies.shape[0]) - 1)
