"""From measurements to moduli and shapes: least squares, with what the data can and cannot tell."""

import math
import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, PyTree

from ..core import calling, progress, tracing, units, validation
from ..core.units import Number, Row
from . import least_squares
from .least_squares import BLIND, Parameters, Residuals

_TOO_LARGE = "the model or sigma is wrong, or another start leads lower"
_UNBEARABLE = 1e-6  # probability of a chi^2 as large as this below which model or sigma is wrong


class Positive(eqx.Module):
    """A parameter that stays above zero: `fit` moves its logarithm.

    **Arguments:** `value`, where the search starts; positive.
    """

    value: Float[Array, ""]

    def __init__(self, value: Number):
        self.value = validation.positive("Positive(value=)", value, None, "the parameter's own unit")


class Fit(eqx.Module):
    """What `fit` found.

    `parameters` and their `standard_errors`, shaped like `start` (infinite where the data do not tell); `residuals`,
    (model - data) / sigma; `chi_square`, the sum of their squares, for so many `degrees_of_freedom` (data less what
    they tell), and `p_value`, the probability that noise of the given sigma makes it as large (NaN without any);
    `unidentified`, a line for each combination of parameters that the data do not change with; `converged`, whether
    the parameters are a minimum of chi^2; `doubts`, a sentence for each reason not to trust them; and the number of
    `steps` of `method`.
    """

    parameters: PyTree
    standard_errors: PyTree
    residuals: Float[Array, " data"]
    chi_square: Float[Array, ""]
    degrees_of_freedom: int
    p_value: float
    unidentified: tuple[str, ...]
    doubts: tuple[str, ...]
    converged: bool
    steps: int
    method: str

    def __repr__(self):
        named = jax.tree_util.tree_leaves_with_path(self.parameters)
        lines = [
            f"{_name(path)} = {value:.6g} +- {error:.2g}"
            for (path, value), error in zip(named, jax.tree.leaves(self.standard_errors), strict=True)
        ]
        ended = "converged" if self.converged else "NOT converged"
        lines.append(
            f"chi^2 = {self.chi_square:.4g} for {self.residuals.size} data, "
            f"{_counted(self.degrees_of_freedom)}; {self.method}, {self.steps} steps, {ended}"
        )
        return "\n".join([*lines, *(f"not identified: {line}" for line in self.unidentified), *self.doubts])


def fit(
    model: Callable[[PyTree], Array],
    data: Row,
    sigma: Row,
    start: PyTree,
    *,
    solver: Any = None,
    max_steps: int | None = None,
) -> Fit:
    """The parameters for which `model(parameters)` is nearest to `data`: least squares weighted by 1 / sigma^2.

    **Arguments:**

    - `model`: any differentiable function of the parameters, returning an array like `data`: frequencies, or points of
      a motion.
    - `data`: what was measured; `sigma`: its standard deviation, one number or one for each.
    - `start`: a pytree of numbers where the search starts, such as a dict; `Positive(x)` keeps one above zero.  `model`
      receives the same pytree with plain numbers.  Zero is a start like any other: `fit` chooses the scale of each
      parameter by how the data change with it.
    - `solver`: an Optimistix least-squares solver or minimiser, or an Optax optimiser such as `optax.adam(0.05)`;
      Levenberg-Marquardt if left out.  It sees a problem without units: the misfit at the start is one.  Steps of Optax
      are relative: of a logarithm, or of the larger of the starting value and the change that the misfit asks for.
    - `max_steps`: the search stops there; 256 if left out, of a minimiser 10,000.

    The search ends at a minimum of chi^2: its gradient is zero beside what a millionth of chi^2 makes, and its Hessian
    has no direction in which chi^2 falls.  If it stops elsewhere, `converged` is False.  It computes in JAX's default
    type, float64 after `jaxrod.configure()`, whatever the type of the data.

    **Returns:** a `Fit`.

    **Raises:** `ValueError` for data, sigma or start that make no sense.  **Warns** when the data leave a combination of
    parameters open, when the search did not converge, and when chi^2 is larger than noise of the given sigma makes it
    once in a million times: then the model or sigma is wrong, and so are the standard errors.

    >>> import jaxrod
    >>> def model(p):
    ...     rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=p["young"], density=1200.0)
    ...     return jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 2)
    >>> found = jaxrod.fit(model, data=[19.24, 67.42], sigma=0.1, start={"young": jaxrod.Positive(3e7)})
    >>> print(f"{found.parameters['young']:.3e} +- {found.standard_errors['young']:.0e} Pa")
    9.999e+06 +- 3e+04 Pa
    """
    if not callable(model):
        raise ValueError(f"model={validation.given(model)} is not a function; give one of the parameters.")
    data, sigma = _measured(data, sigma)
    parameters = _parameters(start, data.dtype)
    method, name = least_squares.method(solver, data.dtype)
    most = 10_000 if isinstance(method, optx.AbstractMinimiser) else 256
    max_steps = most if max_steps is None else validation.count("max_steps", max_steps, 1, "steps")
    dtype = _check(model, data, parameters)

    residuals = Residuals(tracing.carried(model), data, sigma, parameters)
    with progress.line("fit"):
        first = least_squares.point(residuals, dtype)
        if not first.finite:
            raise ValueError("model has a derivative at the start that is not finite; start elsewhere.")
        found = least_squares.minimised(residuals, first, dtype, method, max_steps)
    freedom, chi_square = data.size - found.told.rank, found.point.chi_square
    p_value = float(jax.scipy.special.gammaincc(freedom / 2, chi_square / 2)) if freedom else math.nan
    values, spread = found.parameters.values, jnp.asarray(found.told.spread, data.dtype)
    scaled = zip(spread, values, parameters.positive, strict=True)
    result = Fit(
        parameters=parameters.shaped(values),
        standard_errors=parameters.shaped(x * value if positive else x for x, value, positive in scaled),
        residuals=jnp.asarray(found.point.r, data.dtype),
        chi_square=jnp.asarray(chi_square, data.dtype),
        degrees_of_freedom=freedom,
        p_value=p_value,
        unidentified=tuple(_combination(direction, parameters.names) for direction in found.told.open),
        doubts=_doubts(found, name, max_steps, freedom, p_value),
        converged=not found.doubt,
        steps=found.steps,
        method=name,
    )
    if result.unidentified and result.converged:
        warnings.warn(f"the data do not tell {'; '.join(result.unidentified)}.", stacklevel=2)
    for doubt in result.doubts:
        warnings.warn(doubt, stacklevel=2)
    return result


def _doubts(found: Any, name: str, max_steps: int, freedom: int, p_value: float) -> tuple[str, ...]:
    """A sentence for each reason not to trust what was `least_squares.minimised`."""
    chi_square = found.point.chi_square
    if found.doubt:
        remedy = "raise max_steps or start nearer" if found.steps >= max_steps else "start elsewhere"
        return (f"{name} did not converge in {found.steps} steps: {found.doubt}; {remedy}.",)
    if p_value < _UNBEARABLE or (not freedom and chi_square > 1):
        return (f"chi^2 is {chi_square:.4g} for {_counted(freedom)}: {_TOO_LARGE}.",)
    return ()


def _measured(data: Any, sigma: Any) -> tuple[Array, Array]:
    """Data and as many standard deviations, in JAX's default type."""
    for name, value in (("data", data), ("sigma", sigma)):
        if units.carries_unit(value):
            raise ValueError(f"{name}={value} has a unit, and model's answers have none; give plain numbers in theirs.")
    dtype = jnp.result_type(float)
    data, sigma = validation.reals("data", data).astype(dtype), validation.reals("sigma", sigma).astype(dtype)
    if data.size == 0 or not np.all(np.isfinite(data)):
        raise ValueError(f"data={validation.shown(data)} must be finite numbers, at least one.")
    each = jnp.broadcast_to(sigma, data.shape) if sigma.ndim == 0 else sigma
    if each.shape != data.shape or not np.all(np.isfinite(each) & (each > 0)):
        raise ValueError(
            f"sigma={validation.shown(each)} must be positive, one number or one for each of {data.size} data."
        )
    return data, each


def _parameters(start: PyTree, dtype: Any) -> Parameters:
    leaves, tree = jax.tree_util.tree_flatten_with_path(start, is_leaf=_is_positive)
    if not leaves:
        raise ValueError(f"start={start!r} holds no parameter; give numbers, or Positive(number).")
    values = [
        leaf.value if _is_positive(leaf) else validation.number(f"start{jax.tree_util.keystr(path)}", leaf, unit=None)
        for path, leaf in leaves
    ]
    values = [value.astype(dtype) for value in values]
    return Parameters(values, [_name(path) for path, _ in leaves], [_is_positive(leaf) for _, leaf in leaves], tree)


def _check(model: Callable, data: Array, parameters: Parameters) -> Any:
    """The type in which the model answers, which is that of its rounding."""
    wanted, first = "of the parameters -> an array like data", parameters.shaped(parameters.values)
    calling.tried("model", wanted, model, first)
    there = calling.answer("model", wanted, model, first)
    if jnp.shape(there) != data.shape:
        raise ValueError(f"model returns shape {jnp.shape(there)} but data has shape {data.shape}; they must agree.")
    if not np.all(np.isfinite(there)):
        raise ValueError(f"model gives {validation.shown(there)} at the start, which is not finite; start elsewhere.")
    return jnp.result_type(there)


def _combination(direction: np.ndarray, names: list[str]) -> str:
    """Parameters, in relative changes, that the data leave open together."""
    direction = direction / direction[np.argmax(np.abs(direction))]
    moved = [(name, x) for name, x in zip(names, direction, strict=True) if abs(x) > math.sqrt(BLIND)]
    if len(moved) == 1:
        return moved[0][0]
    if all(abs(x - 1) < 1e-3 for _, x in moved):
        return f"a common factor of {' and '.join(name for name, _ in moved)}"
    return " ".join(f"{name}^{x:.3g}" for name, x in moved)


def _counted(freedom: int) -> str:
    return f"{freedom} degree{'s' * (freedom != 1)} of freedom"


def _is_positive(leaf: Any) -> bool:
    return isinstance(leaf, Positive)


def _name(path: Any) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".")
