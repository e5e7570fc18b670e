"""Operations on single numbers, without those that XLA would not see to be needless.  Knows no rods."""

import functools
import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np


class _Multiple(NamedTuple):
    """A known factor, a power of two with a sign, times a number: kept apart, as derivatives bring many that cancel."""

    factor: float
    number: Any


class Arithmetic:
    """Operations on numbers: as written, but for what XLA would not see to.

    Nothing is added or multiplied that is zero by structure, as derivatives of slices are; equal sums and products are
    one; all quotients by one number share its inverse, as a division costs eight multiplications.
    """

    def __init__(self):
        self._sums: dict[Any, Any] = {}
        self._products: dict[Any, Any] = {}
        self._inverses: dict[int, Any] = {}

    def __call__(self, eqn, numbers: list) -> Any:
        name, params = eqn.primitive.name, eqn.params
        if jnp.issubdtype(eqn.outvars[0].aval.dtype, jnp.floating):
            if name in ("add", "add_any"):
                return self.sum(*numbers)
            if name == "sub":
                return self.sum(numbers[0], self.product(-1.0, numbers[1]))
            if name == "neg":
                return self.product(-1.0, numbers[0])
            if name == "mul":
                return self.product(*numbers)
            if name == "square" or (name == "integer_pow" and params["y"] == 2):
                return self.product(numbers[0], numbers[0])
            if name == "div":
                return self.product(numbers[0], self._inverse(numbers[1]))
            if name == "integer_pow" and params["y"] == -2:
                inverse = self._inverse(numbers[0])
                return self.product(inverse, inverse)
        return eqn.primitive.bind(*map(plain, numbers), **params)

    def total(self, terms) -> Any:
        """The sum of many."""
        return functools.reduce(self.sum, terms, 0.0)

    def sum(self, a, b):
        if _is(a, 0.0) or _is(b, 0.0):
            return b if _is(a, 0.0) else a
        (m, x), (n, y) = _parts(a), _parts(b)
        if x is y:
            return _multiple(m + n, x) if x is None or _binary(m + n) else plain(a) + plain(b)
        if x is None or y is None:
            return plain(a) + plain(b)
        key = frozenset(((m, id(x)), (n, id(y))))
        if key not in self._sums:
            self._sums[key] = (plain(a) - y if n == -1.0 else plain(a) + plain(b), x, y)
        return self._sums[key][0]

    def product(self, a, b):
        if _is(a, 0.0) or _is(b, 0.0):
            return 0.0
        (m, x), (n, y) = _parts(a), _parts(b)
        if x is None or y is None:
            return _multiple(m * n, y if x is None else x)
        key = frozenset((id(x), id(y)))
        if key not in self._products:
            self._products[key] = (x * y, x, y)  # x and y are kept, so that their ids stay their own
        return _multiple(m * n, self._products[key][0])

    def _inverse(self, x):
        m, number = _parts(x)
        if number is None:
            return _Multiple(1 / m, None)
        if id(number) not in self._inverses:
            self._inverses[id(number)] = (1 / number, number)
        return _multiple(1 / m, self._inverses[id(number)][0])


def plain(x: Any) -> Any:
    """A number as JAX knows it."""
    if not isinstance(x, _Multiple):
        return x
    if x.number is None:
        return x.factor
    return x.number if x.factor == 1.0 else -x.number if x.factor == -1.0 else x.factor * x.number


def _multiple(factor: float, number: Any) -> Any:
    return number if factor == 1.0 and number is not None else _Multiple(factor, number)


def _parts(x: Any) -> tuple[float, Any]:
    """A factor that is a power of two, and what is left; None if nothing is."""
    if isinstance(x, _Multiple):
        return x
    known = isinstance(x, float | np.floating) and _binary(float(x))
    return (float(x), None) if known else (1.0, x)


def _binary(x: float) -> bool:
    return bool(x != 0 and math.isfinite(x) and abs(math.frexp(x)[0]) == 0.5)


def _is(x: Any, value: float) -> bool:
    return bool(isinstance(x, float | np.floating) and x == value)
