"""What one wants to know of a run: numbers with a unit, and the range that they can lie in."""

import abc
import warnings
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import continuum
from ..core import calling, validation
from ..mechanics.system import System
from ..mechanics.vibration import natural_frequencies
from ..rods.rod import Rod


class AbstractQuantity(eqx.Module):
    """A function of a solution, with a unit."""

    name: eqx.AbstractVar[str]
    unit: eqx.AbstractVar[str]  # empty if it has none

    @abc.abstractmethod
    def __call__(self, solution: Any) -> Float[Array, "*numbers"]:
        """Of a `Solution`, or of anything else with its angle, tip, strain."""

    def times(self, t0: float, t1: float) -> Float[Array, " T"]:
        """When a run must be saved for it: at the end."""
        del t0
        return jnp.array([t1])

    def span(self, system: System) -> Float[Array, ""]:
        """The largest difference that two answers can have; inf where there is none."""
        del system
        return jnp.asarray(jnp.inf)

    def exact(self, system: System) -> Float[Array, "*numbers"] | None:
        """Of the exact rod, where that is known without a run."""
        del system
        return None


class FirstFrequency(AbstractQuantity):
    """The first axial natural frequency in Hz: of the scene, whatever moves; inf of a rigid rod."""

    name: ClassVar[str] = "first frequency"
    unit: ClassVar[str] = "Hz"

    def __call__(self, solution: Any):
        frequencies = natural_frequencies(solution.system)
        return frequencies[0] if frequencies.size else jnp.asarray(jnp.inf, frequencies.dtype)

    def exact(self, system: System):
        return continuum.natural_frequencies(system, 1)[0] if isinstance(system.rod, Rod) else None


class LargestStrain(AbstractQuantity):
    """The largest elongation over length, either way, at the times that are saved; or the largest strain of the section `at`
    (m from the root).

    **Raises:** `ValueError` where `at` lies beyond the rod.

    `budget`, `plan` and `tradeoff` ask for it at the 200 `times(t0, t1)`: save those to see the same.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.02), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.LoadRitz(3), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(), t1=0.5)
    >>> bool(jaxrod.LargestStrain(at=0.0)(sol) > jaxrod.LargestStrain()(sol))
    True
    """

    name: ClassVar[str] = "largest strain"
    unit: ClassVar[str] = ""
    at: Any = None

    def __check_init__(self):
        if self.at is not None:
            validation.number("at", self.at, unit="m")

    def __call__(self, solution: Any):
        if self.at is None:
            return jnp.max(jnp.abs(solution.strain), axis=-1)
        length = solution.system.rod.length
        at = validation.number("at", self.at, unit="m")
        if validation.fails(lambda at, length: (at >= 0) & (at <= length), at, length):
            raise ValueError(
                f"at={validation.shown(at)} m lies beyond the rod; it must be within length={validation.shown(length)} m."
            )
        return jnp.max(jnp.abs(solution.strain_field(at[None])), axis=(-2, -1))

    def times(self, t0: float, t1: float):
        return jnp.linspace(t0, t1, 201)[1:]


class FinalAngle(AbstractQuantity):
    """The angle above the horizontal in rad at the last time; in the plane counted over all turns.

    Beyond a radian an error of the angle means that the phase is lost.
    """

    name: ClassVar[str] = "angle"
    unit: ClassVar[str] = "rad"

    def __call__(self, solution: Any):
        return solution.angle[..., -1]

    def span(self, system: System):
        return jnp.asarray(4.0)


class FinalTip(AbstractQuantity):
    """The position of the tip in m at the last time, (D,)."""

    name: ClassVar[str] = "tip"
    unit: ClassVar[str] = "m"

    def __call__(self, solution: Any):
        return solution.tip[..., -1, :]

    def span(self, system: System):
        return 2 * system.rod.length


class CustomQuantity(AbstractQuantity):
    """A quantity of your own: `function` of a solution, its `unit`, and how far apart answers can lie at the most: one
    positive number, or one for each that the function returns.

    >>> import jaxrod
    >>> jaxrod.CustomQuantity(lambda sol: sol.energy[-1], "J").unit
    'J'
    """

    function: Callable[[Any], Any]
    unit: str = eqx.field(static=True)
    largest: Any
    name: str = eqx.field(static=True)

    def __init__(self, function: Callable[[Any], Any], unit: str = "", largest: Any = jnp.inf, name: str = "quantity"):
        if isinstance(function, type) or not callable(function):
            raise ValueError(
                f"CustomQuantity(function={validation.given(function)}) is not a function; give one of a solution."
            )
        for said, value in (("unit", unit), ("name", name)):
            if not isinstance(value, str):
                raise ValueError(
                    f"CustomQuantity({said}={validation.given(value)}) is not text; give a string such as 'm'."
                )
        if validation.fails(lambda largest: largest > 0, validation.reals("CustomQuantity(largest=)", largest)):
            raise ValueError(
                f"CustomQuantity(largest={validation.given(largest)}) must be positive, one number or one for each; "
                "inf if there is none."
            )
        self.function, self.unit, self.largest, self.name = function, unit, largest, name

    def __call__(self, solution: Any):
        value = calling.answer(self.name, "of a solution -> one array", self.function, solution)
        if np.ndim(self.largest) and np.shape(self.largest) != value.shape:
            raise ValueError(
                f"CustomQuantity(largest=) of shape {np.shape(self.largest)} does not fit the {self.name}, of "
                f"shape {value.shape}; give one number, or one for each."
            )
        return value

    def span(self, system: System):
        return jnp.asarray(self.largest)


class Measured(CustomQuantity):
    """The name that `CustomQuantity` had; it goes with the next release."""

    def __init__(self, function: Callable[[Any], Any], unit: str = "", largest: Any = jnp.inf, name: str = "quantity"):
        warnings.warn("jaxrod.Measured is called jaxrod.CustomQuantity now.", FutureWarning, stacklevel=4)
        super().__init__(function, unit, largest, name)


def as_quantity(given: AbstractQuantity | Callable[[Any], Any] | None) -> AbstractQuantity:
    """A quantity, a function of a solution as one, or the tip where nothing is given.

    **Raises:** `ValueError` for anything else.
    """
    if given is None:
        return FinalTip()
    if isinstance(given, AbstractQuantity):
        return given
    if isinstance(given, type) or not callable(given):
        shown = given.__name__ if isinstance(given, type) else validation.given(given)
        raise ValueError(
            f"quantity {shown} cannot be asked for; give one, such as FinalTip(), or a function of a solution."
        )
    return CustomQuantity(given)
