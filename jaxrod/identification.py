"""From measurements to moduli and shapes: least squares, with what the data can and cannot tell."""

import math
import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
from jaxtyping import Array, ArrayLike, Float, PyTree

from . import calling, checks

_BLIND = 1e-7  # a direction in which the data change this many times less than in the best one is not identified
_EXACT = 1e-6  # standard deviations of the data, below which residuals are rounding


class Positive(eqx.Module):
    """A parameter that stays above zero: `fit` moves its logarithm.

    **Arguments:** `value`, where the search starts; positive.
    """

    value: Float[Array, ""]

    def __init__(self, value):
        self.value = checks.positive("Positive(value=)", value, "the parameter's own unit")


class Fit(eqx.Module):
    """What `fit` found.

    `parameters` and their `standard_errors`, shaped like `start` (infinite where the data do not tell); `residuals`,
    (model - data) / sigma; `chi_square`, the sum of their squares; `unidentified`, a line for each combination of
    parameters that the data do not change with; `converged` and the number of `steps` of `method`.
    """

    parameters: PyTree
    standard_errors: PyTree
    residuals: Float[Array, " data"]
    chi_square: Float[Array, ""]
    unidentified: tuple[str, ...]
    converged: bool
    steps: int
    method: str

    def __str__(self):
        named = jax.tree_util.tree_leaves_with_path(self.parameters)
        lines = [
            f"{_name(path)} = {value:.6g} +- {error:.2g}"
            for (path, value), error in zip(named, jax.tree.leaves(self.standard_errors), strict=True)
        ]
        ended = "converged" if self.converged else "NOT converged"
        lines.append(
            f"chi^2 = {self.chi_square:.4g} for {self.residuals.size} data; {self.method}, {self.steps} steps, {ended}"
        )
        return "\n".join([*lines, *(f"not identified: {line}" for line in self.unidentified)])


def fit(
    model: Callable[[PyTree], Array],
    data: ArrayLike,
    sigma: ArrayLike,
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
      receives the same pytree with plain numbers.
    - `solver`: an Optimistix least-squares solver or minimiser, or an Optax optimiser such as `optax.adam(0.05)`;
      Levenberg-Marquardt if left out.  Steps are relative: of a logarithm, or of the starting value.
    - `max_steps`: the search stops there, `converged` is then False; 256 if left out, of an optimiser 10,000.

    **Returns:** a `Fit`.

    **Raises:** `ValueError` for data, sigma or start that make no sense.  **Warns** when the data leave a combination of
    parameters open, or the search did not converge.

    >>> import jaxrod
    >>> def model(p):
    ...     rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=p["young"], density=1200.0)
    ...     return jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 2)
    >>> found = jaxrod.fit(model, data=[19.24, 67.42], sigma=0.1, start={"young": jaxrod.Positive(3e7)})
    >>> print(f"{found.parameters['young']:.3e} +- {found.standard_errors['young']:.0e} Pa")
    9.999e+06 +- 3e+04 Pa
    """
    if not callable(model):
        raise ValueError(f"model={checks.given(model)} is not a function; give one of the parameters.")
    if max_steps is not None:
        max_steps = checks.count("max_steps", max_steps, 1, "steps")
    data, sigma = checks.reals("data", data), checks.reals("sigma", sigma)
    sigma = jnp.broadcast_to(sigma, data.shape) if sigma.ndim == 0 else sigma
    space = _Parameters(start)
    _check(model, data, sigma, space)
    residuals = _Residuals(model if isinstance(model, eqx.Module) else jax.tree_util.Partial(model), data, sigma, space)
    origin = jnp.zeros(len(space.names), dtype=data.dtype)
    method, name = _method(solver)
    if max_steps is None:
        max_steps = 10_000 if isinstance(method, optx.AbstractMinimiser) else 256
    theta, rest, jacobian, converged, steps = _search(residuals, origin, method, max_steps)
    spread, unidentified = _identified(np.asarray(jacobian), space.names)
    parameters = space.parameters(theta)
    result = Fit(
        parameters=parameters,
        standard_errors=space.scaled(jnp.asarray(spread, theta.dtype), parameters),
        residuals=rest,
        chi_square=rest @ rest,
        unidentified=unidentified,
        converged=bool(converged),
        steps=int(steps),
        method=name,
    )
    if unidentified:
        warnings.warn(f"the data do not tell {'; '.join(unidentified)}.", stacklevel=2)
    if not result.converged:
        warnings.warn(
            f"{name} did not converge in {result.steps} steps; raise max_steps or start nearer.", stacklevel=2
        )
    return result


@eqx.filter_jit
def _search(residuals, origin, method, max_steps):
    """Compiled once for a model: a second fit of other data with the same function starts at once."""
    mode = _derivative_mode(residuals, origin)
    found = optx.least_squares(residuals, method, origin, options={"jac": mode}, max_steps=max_steps, throw=False)
    jacobian = (jax.jacfwd if mode == "fwd" else jax.jacrev)(residuals)(found.value, None)
    # An exact fit leaves rounding alone, in which no step is accepted as better: that is an end, too.
    exact = jnp.max(jnp.abs(residuals(found.value, None))) < _EXACT
    converged = (found.result == optx.RESULTS.successful) | exact
    return found.value, residuals(found.value, None), jacobian, converged, found.stats["num_steps"]


class _Residuals(eqx.Module):
    """(model - data) / sigma as a function of theta."""

    model: Any  # from parameters to an array like data
    data: Array
    sigma: Array
    space: "_Parameters"

    def __call__(self, theta, _):
        return ((self.model(self.space.parameters(theta)) - self.data) / self.sigma).reshape(-1)


class _Parameters(eqx.Module):
    """The map between the parameters and theta, a vector of relative changes that is zero at the start."""

    starts: list[Float[Array, ""]]
    names: list[str] = eqx.field(static=True)
    positive: list[bool] = eqx.field(static=True)
    tree: Any = eqx.field(static=True)

    def __init__(self, start: PyTree):
        leaves, self.tree = jax.tree_util.tree_flatten_with_path(start, is_leaf=_is_positive)
        if not leaves:
            raise ValueError(f"start={checks.given(start)} holds no parameter; give numbers, or Positive(number).")
        self.names = [_name(path) for path, _ in leaves]
        self.positive = [_is_positive(leaf) for _, leaf in leaves]
        self.starts = [
            leaf.value if _is_positive(leaf) else checks.number(f"start{jax.tree_util.keystr(path)}", leaf)
            for path, leaf in leaves
        ]

    def parameters(self, theta: Float[Array, " n"]) -> PyTree:
        values = [
            start * jnp.exp(x) if positive else start + _scale(start) * x
            for x, start, positive in zip(theta, self.starts, self.positive, strict=True)
        ]
        return jax.tree_util.tree_unflatten(self.tree, values)

    def scaled(self, spread: Float[Array, " n"], parameters: PyTree) -> PyTree:
        """Small changes of theta as changes of the parameters."""
        values = jax.tree.leaves(parameters)
        changes = [
            x * value if positive else x * _scale(start)
            for x, value, start, positive in zip(spread, values, self.starts, self.positive, strict=True)
        ]
        return jax.tree_util.tree_unflatten(self.tree, changes)


def _scale(start: Array) -> Array:
    return jnp.where(start == 0, 1.0, jnp.abs(start))


def _method(solver: Any) -> tuple[Any, str]:
    if solver is None:
        solver = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
    if isinstance(solver, optax.GradientTransformation):
        return optx.OptaxMinimiser(solver, rtol=1e-9, atol=1e-9), "Optax"
    if isinstance(solver, optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser):
        return solver, type(solver).__name__
    raise ValueError(
        f"solver={checks.given(solver)} is no solver; give one of Optimistix, such as LevenbergMarquardt, or of Optax."
    )


def _derivative_mode(residuals: Callable, theta: Array) -> str:
    """ "fwd" if the model can be differentiated forward, which is cheaper for few parameters; else "bwd".

    A `simulate` inside the model can, if it is given `adjoint=diffrax.ForwardMode()`.
    """
    try:
        jax.eval_shape(lambda theta: jax.jacfwd(residuals)(theta, None), theta)
    except TypeError:  # a custom_vjp, as in Diffrax's default adjoint
        return "bwd"
    return "fwd"


def _identified(jacobian: np.ndarray, names: list[str]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Standard deviation of each theta, and the combinations that the data leave open."""
    _, values, directions = np.linalg.svd(jacobian, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(names) - len(values))])
    open_ = values <= _BLIND * values[0]
    variance = np.sum((directions[~open_] / values[~open_, None]) ** 2, axis=0)
    touched = np.max(np.abs(directions[open_]), axis=0, initial=0.0) > math.sqrt(_BLIND)
    lines = []
    for direction in directions[open_]:
        direction = direction / direction[np.argmax(np.abs(direction))]
        moved = [(name, x) for name, x in zip(names, direction, strict=True) if abs(x) > math.sqrt(_BLIND)]
        if len(moved) > 1 and all(abs(x - 1) < 1e-3 for _, x in moved):
            lines.append(f"a common factor of {' and '.join(name for name, _ in moved)}")
        else:
            lines.append(" ".join(f"{name}^{x:.3g}" for name, x in moved))
    return np.where(touched, np.inf, np.sqrt(variance)), tuple(lines)


def _check(model: Callable, data: Array, sigma: Array, space: _Parameters) -> None:
    if data.size == 0 or not np.all(np.isfinite(data)):
        raise ValueError(f"data={checks.shown(data)} must be finite numbers, at least one.")
    if sigma.shape != data.shape or not np.all(np.isfinite(sigma) & (sigma > 0)):
        raise ValueError(
            f"sigma={checks.shown(sigma)} must be positive, one number or one for each of {data.size} data."
        )
    wanted, first = (
        "of the parameters -> an array like data",
        space.parameters(jnp.zeros(len(space.names), dtype=data.dtype)),
    )
    calling.tried("model", wanted, model, first)
    there = calling.answer("model", wanted, model, first)
    if jnp.shape(there) != data.shape:
        raise ValueError(f"model returns shape {jnp.shape(there)} but data has shape {data.shape}; they must agree.")
    if not np.all(np.isfinite(there)):
        raise ValueError(f"model gives {checks.shown(there)} at the start, which is not finite; start elsewhere.")


def _is_positive(leaf: Any) -> bool:
    return isinstance(leaf, Positive)


def _name(path: Any) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".")
