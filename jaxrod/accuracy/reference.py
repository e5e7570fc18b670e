"""What the exact rod says of a quantity, and how well it knows."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from .. import continuum
from ..continuum.simulation import by_first_modes
from ..core import progress
from ..mechanics.system import System
from ..motions.state import State
from ..rods.rod import Rod
from .quantity import AbstractQuantity, CustomQuantity

_MODES = (8, 16, 32, 64, 128, 256)
_ARRAYS = {8: 16, 32: 64}  # in those of twice the modes, whose program comes next
_MOST_STEPS = 2e5  # radians of the highest mode in a run: some seconds


class Answer(NamedTuple):
    """The `value` of a quantity, by how much half as many modes change it, `apart`, and whether there was time for the `most`."""

    value: np.ndarray
    apart: float
    complete: bool


def exact_answer(
    system: System, start: State, quantity: AbstractQuantity, t0: float, ts: Any, static: bool, wanted: float, most: int = 256
) -> Answer | None:  # fmt: skip
    """By twice the modes again and again, to `most`, until that changes no more than is `wanted`.

    **Returns:** the best there is time for, or None where that is none: a scene or a function that the exact rod does not take,
    too many periods.  Where it does not reach its end the value is NaN, and `apart` inf.

    **Raises:** `ValueError` where no `static` strain holds the rod.
    """
    if not isinstance(system.rod, Rod) or continuum.untaken(system, static):
        return None
    known = quantity.exact(system)
    if known is not None:
        return Answer(np.asarray(known, float), 0.0, True)
    radians = (
        2 * np.pi * float(continuum.natural_frequencies(dataclasses.replace(system, forces=()), 1)[0] * (ts[-1] - t0))
    )
    before, answer = None, None
    for modes in _MODES:
        if modes > most or modes * radians > _MOST_STEPS:
            break
        progress.say(f"the exact rod by {modes} modes")
        run = by_first_modes(
            modes, system, start, ts=ts, t0=t0, static=static, modes=_ARRAYS.get(modes, modes), error=False
        )
        if not bool(run.ok):
            return Answer(np.asarray(np.nan), np.inf, False)
        try:
            value = np.asarray(quantity(run), float)
        except ValueError as error:
            if isinstance(error.__cause__, AttributeError):  # a function of what the exact rod has not
                return None
            raise
        if before is not None:
            answer = Answer(value, apart(value, before), modes == most)
            if answer.apart <= wanted:
                break
        before = value
    return answer


def comparable(quantity: AbstractQuantity) -> bool:
    """Whether the quantity is one of motion, which the exact rod has too: functions of one's own may read what it has not."""
    return not isinstance(quantity, CustomQuantity)


def apart(a: Any, b: Any) -> float:
    """The largest difference; inf where there is none to be seen."""
    return float(np.nan_to_num(np.max(np.abs(np.asarray(a) - np.asarray(b))), nan=np.inf))
