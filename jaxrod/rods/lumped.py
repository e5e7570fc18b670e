"""A pivoted body that four numbers describe."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import precision, validation
from ..core.units import Number


class Lumped(eqx.Module):
    """A pivoted body with one uniform strain, given by four numbers: the spring pendulum with inertia.

    With one strain a pivoted rod *is* this: inertia I, first moment S = m x_C and stiffness C = int E A ds.  It carries
    formulas that no rod has (the paper's literal mixture) and the elastic-pendulum literature.

    **Arguments:** `inertia` in kg m^2, `first_moment` in kg m (zero: pivoted at the centre of mass), `stiffness` in
    N m (c l0^2 for a spring constant c), `length` in m.

    A point mass m on a spring c of unstretched length l:

    >>> import jaxrod
    >>> m, c, l = 1.0, 33.0, 0.1
    >>> jaxrod.Lumped(inertia=m * l**2, first_moment=m * l, stiffness=c * l**2, length=l)
    Lumped(inertia=0.01 kg m^2, first_moment=0.1 kg m, stiffness=0.33 N m, length=0.1 m, float64)
    """

    inertia: Float[Array, ""]
    first_moment: Float[Array, ""]
    stiffness: Float[Array, ""]
    length: Float[Array, ""]

    def __init__(self, inertia: Number, first_moment: Number, stiffness: Number, length: Number):
        self.inertia = validation.positive("inertia", inertia, "kg m^2")
        self.first_moment = validation.number("first_moment", first_moment, unit="kg m")
        self.stiffness = validation.positive(
            "stiffness", stiffness, "N m", "N m (spring constant times length squared)"
        )
        self.length = validation.positive("length", length, "m")

    def valid(self) -> Array:
        """Whether the numbers make a body: the same questions as at construction, for traced values."""
        numbers = jnp.stack([self.inertia, self.stiffness, self.length])
        return jnp.all(jnp.isfinite(numbers) & (numbers > 0)) & jnp.isfinite(self.first_moment)

    def __repr__(self):
        return validation.written(
            self, precision.float_type(self), inertia="kg m^2", first_moment="kg m", stiffness="N m", length="m"
        )
