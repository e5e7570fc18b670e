"""Strain laws: energy density over Young's modulus, W(strain), of a bar stretched to 1 + strain of its length.

Each is a plain function of an array of strains with W(0) = W'(0) = 0 and W''(0) = 1, so that all agree at small strain.
W' is the nominal (first Piola-Kirchhoff) stress over E.  A law of your own is three lines:

>>> import jaxrod
>>> def stiffening(strain):
...     return strain**2 / 2 + 10 * strain**4
>>> rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.025), young=1e7, density=1200.0, law=stiffening)
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import validation

Strains = Float[Array, "*points"]


def hooke(strain: Strains) -> Strains:
    """Linear in the engineering strain: W = strain^2 / 2.  `Rod` takes it when no law is given, as a matrix."""
    return validation.reals("strain", strain) ** 2 / 2


def green(strain: Strains) -> Strains:
    """Green and Saint-Venant, linear in e = strain + strain^2 / 2: W = e^2 / 2.  Loses its stiffness at strain -0.42."""
    strain = validation.reals("strain", strain)
    return (strain + strain**2 / 2) ** 2 / 2


def logarithmic(strain: Strains) -> Strains:
    """Hencky, linear in the true strain: W = ln(1 + strain)^2 / 2.  Softens; the greatest nominal stress is at 1.72."""
    return jnp.log1p(validation.reals("strain", strain)) ** 2 / 2


def neo_hookean(strain: Strains) -> Strains:
    """Incompressible rubber under tension, stretch x = 1 + strain, E = 3 mu: W = (x^2 + 2 / x - 3) / 6."""
    strain = validation.reals("strain", strain)
    # (x - 1)^2 (x + 2) / x = x^2 + 2 / x - 3, without the cancellation at small strain.
    return strain**2 * (3 + strain) / (6 * (1 + strain))
