"""Quantities that carry units become plain numbers in SI here, and nowhere else.

NumPy and JAX strip units with a warning at best, so whoever takes a number from a user asks `in_unit` first.  A quantity
is what has the `to`, `magnitude` and `units` of Pint's, of any registry; Pint itself is imported for strings alone.
"""

import re
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import jax
import numpy as np
from jax.typing import ArrayLike


@runtime_checkable
class Quantity(Protocol):
    """A number, or several, with a unit, such as Pint's."""

    @property
    def magnitude(self) -> Any: ...

    @property
    def units(self) -> Any: ...

    def to(self, *unit: Any) -> Any: ...


# What users give: one number, and some in a row.
Number = ArrayLike | Quantity
Row = ArrayLike | Quantity | Sequence[ArrayLike | Quantity]

_SI = {"[length]": "m", "[mass]": "kg", "[time]": "s", "[temperature]": "K", "[current]": "A", "[substance]": "mol"}
_WRITTEN = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*((?:[^\W\d]|[²³·%°*/^()\s]|(?<=[*^-])\d|-)*)")


def in_unit(name: str, value: Any, unit: str | None) -> Any:
    """`value` as plain numbers in `unit`, such as "m" or "kg/m^3"; "" for none, None for SI whatever it measures.

    What carries no unit is returned as it is; of lists and arrays of quantities come lists of numbers.

    **Raises:** `ValueError` for a quantity that does not convert to `unit`, and for one without Pint's names.

    >>> import jaxrod.core.units, pint
    >>> jaxrod.core.units.in_unit("length", pint.Quantity(2000, "mm"), "m")
    2.0
    """
    if not carries_unit(value):
        return value
    if _several(value):
        return [in_unit(name, x, unit) for x in value]
    if not all(hasattr(value, x) for x in ("to", "magnitude", "units", "dimensionality")):
        raise ValueError(
            f"{name}={value} is a quantity of {type(value).__module__.split('.')[0]}, which is not converted; "
            f"give {_number_in(unit)}, or a quantity of Pint."
        )
    return _converted(name, value, unit)


def read(text: str, unit: str) -> float:
    """The number in `unit` that a text such as "210 GPa" or "7.8 g/cm^3" stands for.

    **Raises:** `ValueError` for what is not a number with a unit that converts, and where Pint is not installed.

    >>> import jaxrod.core.units
    >>> jaxrod.core.units.read("210 GPa", "Pa")
    210000000000.0
    """
    try:
        import pint
    except ImportError:
        raise ValueError(f"'{text}' has a unit, which Pint reads: pip install 'jaxrod[units]'.") from None
    written = _WRITTEN.fullmatch(text)
    try:
        if written is None:
            raise ValueError
        registry = pint.get_application_registry()
        value = registry.Quantity(float(written[1]), registry.parse_units(written[2].strip()))
    except Exception:  # Pint's parser has many
        raise ValueError(f"'{text}' is not a number with a unit; write it as in '210 GPa' or '7.8 g/cm^3'.") from None
    return float(_converted(f"'{text}'", value, unit))


def of(value: Any) -> Any:
    """The unit of a quantity, or of the first of several; None of plain numbers.  It can be compared and hashed."""
    if not carries_unit(value):
        return None
    return of(value[0]) if _several(value) else getattr(value, "units", None)


def fits(name: str, what: str, given: Any, unit: str) -> None:
    """Refuse, by `ValueError`, `what` was given with the unit `given` (None: with none) where `unit` is needed."""
    if given is not None:
        try:
            (1.0 * given).to(unit)
        except Exception:  # of the registry, whichever it is
            raise ValueError(
                f"{name} is {what} in {given}, which does not convert to {unit}; give one in {unit}."
            ) from None


def carries_unit(value: Any) -> bool:
    """Whether a value, or what it holds, has a unit that NumPy would strip."""
    if isinstance(value, int | float | str | np.generic | jax.Array):
        return False
    if _several(value):
        return any(map(carries_unit, value))
    held = (value, getattr(value, "dtype", None), getattr(value, "data", None))
    return any(hasattr(x, "unit") or hasattr(x, "units") for x in held)


def _several(value: Any) -> bool:
    return isinstance(value, list | tuple) or (type(value) is np.ndarray and value.dtype == object and value.ndim > 0)


def _converted(name: str, value: Any, unit: str | None) -> Any:
    if unit is None:
        unit = "*".join(f"{_SI[kind]}**{power}" for kind, power in value.dimensionality.items())
    elif "rad" in unit and "hertz" in str(value.units):
        raise ValueError(
            f"{name}={value} does not say of what; give turns as rpm or revolution/s, or {_number_in(unit)}."
        )
    elif "rad" not in unit and "radian" in str(value.to_root_units().units):
        raise ValueError(f"{name}={value} is an angle; give {_number_in(unit)}.")
    try:
        return value.to(unit).magnitude
    except Exception:  # of the registry, whichever it is
        raise ValueError(f"{name}={value} does not convert to {unit or 'a number'}; give {_number_in(unit)}.") from None


def _number_in(unit: str | None) -> str:
    return f"a number in {unit or 'SI'}" if unit != "" else "a number without a unit"
