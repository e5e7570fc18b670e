"""A least-squares problem of few parameters: its scales, its search, and whether a point is a minimum.

Coordinates z are changes of the parameters, of positive ones of their logarithm; z = 0 is where the search stands.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
from jaxtyping import Array, Float, PyTree

from ..core import calling, progress, validation

BLIND = 1e-7  # a direction in which the data change this many times less than in the best one is not identified
_ROUNDING = 1000  # of a model, in units of its type's last digit
_NOTICED = 1e-6  # chi^2 must not fall by more than this part of itself (or of one) from a minimum
_LEG = 32  # steps of a least-squares search after which it is judged, and its scales are chosen anew
_TRUST = 30.0  # units that damp the first least-squares step by a thousandth
_FOLD = 0.1  # a logarithm that still goes so far is not at rest: near zero and infinity chi^2 hardly changes
_FOLDS = np.array([3.0, 10.0, 30.0])  # of a positive parameter that starts far from its size
_AROUND = 0.01  # how far a minimum is looked around, in units of the misfit


class Parameters(eqx.Module):
    """The map from coordinates z to the parameters."""

    values: list[Float[Array, ""]]
    names: list[str] = eqx.field(static=True)
    positive: list[bool] = eqx.field(static=True)
    tree: Any = eqx.field(static=True)

    def at(self, z: Float[Array, " n"]) -> list[Float[Array, ""]]:
        each = zip(z, self.values, self.positive, strict=True)
        return [value * jnp.exp(x) if positive else value + x for x, value, positive in each]

    def moved(self, z: Float[Array, " n"]) -> "Parameters":
        return eqx.tree_at(lambda p: p.values, self, self.at(z))

    def shaped(self, values: Any) -> PyTree:
        """Numbers, one for each parameter, in the shape of the user's start."""
        return jax.tree_util.tree_unflatten(self.tree, list(values))

    @property
    def sizes(self) -> np.ndarray:
        """Size of each parameter in its coordinate: one for a logarithm."""
        return np.where(self.positive, 1.0, np.abs(np.asarray(self.values)))


class Residuals(eqx.Module):
    """(model - data) / sigma as a function of z."""

    model: Any  # from the user's pytree to an array like data
    data: Array
    sigma: Array
    parameters: Parameters

    def __call__(self, z, _=None):
        p = self.parameters
        return ((calling.real(self.model(p.shaped(p.at(z)))) - self.data) / self.sigma).reshape(-1)


class Point(NamedTuple):
    """Where a search stands: the residuals and their derivative by z there, and the size of their rounding."""

    r: np.ndarray
    J: np.ndarray
    noise: float
    mode: str

    @property
    def chi_square(self) -> float:
        return float(self.r @ self.r)

    @property
    def finite(self) -> bool:
        return bool(np.all(np.isfinite(self.r)) and np.all(np.isfinite(self.J)))

    def sensitivity(self) -> np.ndarray:
        """How far all data together move with each parameter, in standard deviations a unit of z."""
        return np.linalg.norm(self.J, axis=0)


@eqx.filter_jit
def _linear(residuals: Residuals, z: Array):
    mode = _derivative_mode(residuals, z)
    r = residuals(z)
    return r, (jax.jacfwd if mode == "fwd" else jax.jacrev)(residuals)(z), mode


def point(residuals: Residuals, dtype: Any, z: np.ndarray | None = None) -> Point:
    """The problem at z, linear; `dtype` is the model's own."""
    where = jnp.zeros(len(residuals.parameters.names), residuals.data.dtype)
    r, J, mode = _linear(residuals, where if z is None else where + z)
    data = np.asarray(residuals.data / residuals.sigma, float).reshape(-1)
    r = np.asarray(r, float)
    noise = _ROUNDING * float(jnp.finfo(dtype).eps) * float(np.linalg.norm(np.abs(r) + 2 * np.abs(data)))
    return Point(r, np.asarray(J, float), noise, mode)


def searched(residuals: Residuals, here: Point, method: Any, steps: int) -> tuple[np.ndarray, int]:
    """Where `method` goes from here within so many steps, and how many it took.

    It sees the misfit as one, and each parameter in the change that would move the data by it: a solver's tolerances
    and first steps are right whatever the units.
    """
    least = here.noise / _ROUNDING / tolerance(residuals.data.dtype)
    misfit = max(float(np.linalg.norm(here.r)), least) or 1.0
    with np.errstate(divide="ignore"):
        needed = misfit / here.sensitivity()
    p = residuals.parameters
    sizes = np.where(p.sizes > 0, p.sizes, 1.0)
    if isinstance(method, optx.OptaxMinimiser):  # its steps are relative, as its learning rate says
        units = np.where(p.positive, 1.0, np.maximum(needed, p.sizes))
    else:
        # A minimiser takes one for the Hessian, at first.
        trust = 1.0 if isinstance(method, optx.AbstractMinimiser) else _TRUST
        units = np.where(p.positive, trust * np.minimum(needed, 1.0), trust * needed)
    units = np.where(np.isfinite(units), units, sizes)
    dtype = residuals.data.dtype
    z, taken = _search(residuals, jnp.asarray(units, dtype), jnp.asarray(misfit, dtype), method, steps, here.mode)
    return np.asarray(z), int(taken)


@eqx.filter_jit
def _search(residuals, units, misfit, method, steps, mode):
    found = optx.least_squares(
        lambda y, _: residuals(units * y) / misfit,
        method, jnp.zeros_like(units), options={"jac": mode}, max_steps=steps, throw=False,
    )  # fmt: skip
    return units * found.value, found.stats["num_steps"]


def tolerance(dtype: Any) -> float:
    """What a search can ask for in this type."""
    return float(jnp.finfo(dtype).eps) ** (2 / 3)


def method(solver: Any, dtype: Any) -> tuple[Any, str]:
    """What searches, and its name."""
    if solver is None:
        solver = optx.LevenbergMarquardt(rtol=tolerance(dtype), atol=tolerance(dtype))
    if isinstance(solver, optax.GradientTransformation):
        return optx.OptaxMinimiser(solver, rtol=1e-9, atol=1e-9), "Optax"
    if isinstance(solver, optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser):
        return solver, type(solver).__name__
    raise ValueError(
        f"solver={validation.given(solver)} is no solver; give one of Optimistix, such as LevenbergMarquardt, or of Optax."
    )


def _derivative_mode(residuals: Callable, z: Array) -> str:
    """ "fwd" if the model can be differentiated forward, which is cheaper for few parameters; else "bwd".

    A `simulate` inside the model can, if it is given `adjoint=diffrax.ForwardMode()`.
    """
    try:
        jax.eval_shape(lambda z: jax.jacfwd(residuals)(z), z)
    except TypeError:  # a custom_vjp, as in Diffrax's default adjoint
        return "bwd"
    return "fwd"


# ---- what a point is


class Told(NamedTuple):
    """What the data tell at a point, where the residuals are taken as linear."""

    spread: np.ndarray  # standard deviation of each coordinate
    blind: np.ndarray  # which parameters the data do not change with at all
    open: np.ndarray  # (k, n): directions of z, relative to the sizes, that the data leave open
    rank: int
    gain: float  # what chi^2 falls by on the way to its minimum
    step: np.ndarray  # that way, in z


def told_at(residuals: Residuals, here: Point, dtype: Any) -> Told:
    """By singular values of the derivative, each column over its own length: units do not matter."""
    length, sizes, blind = here.sensitivity(), residuals.parameters.sizes, _blind(residuals, here, dtype)
    seen = length[~blind]
    left, values, directions = np.linalg.svd(here.J[:, ~blind] / seen, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(seen) - len(values))])
    rank = int(np.sum(values > BLIND * max(values, default=0.0)))
    told, dark = directions[:rank] / values[:rank, None], directions[rank:]
    touched = np.max(np.abs(dark), axis=0, initial=0.0) > np.sqrt(BLIND)
    spread, step, relative = np.full(len(length), np.inf), np.zeros(len(length)), np.zeros((len(dark), len(length)))
    spread[~blind] = np.where(touched, np.inf, np.sqrt(np.sum(told**2, axis=0)) / seen)
    relative[:, ~blind] = dark / np.where(sizes[~blind] > 0, seen * sizes[~blind], 1.0)
    along = left.T[:rank] @ here.r
    step[~blind] = -(along @ told) / seen
    open_ = np.concatenate([relative, np.eye(len(length))[blind]])
    return Told(spread, blind, open_, rank, float(along @ along), step)


def _blind(residuals: Residuals, here: Point, dtype: Any) -> np.ndarray:
    """Parameters without influence.  A derivative near rounding is one only if the data move as it says."""
    length, p = here.sensitivity(), residuals.parameters
    blind = length == 0
    for k in np.flatnonzero(~blind & (length * p.sizes <= here.noise)):
        moved = max(_AROUND * float(np.linalg.norm(here.r)), 10 * here.noise)
        with np.errstate(over="ignore"):
            change = np.log1p(moved / length[k]) if p.positive[k] else moved / length[k]
        there = point(residuals, dtype, change * np.eye(len(length))[k])
        blind[k] = not np.linalg.norm(there.r - here.r - here.J[:, k] * moved / length[k]) < moved / 2
    return blind


def noticeable(here: Point, first: Point) -> float:
    """The fall of chi^2 that matters: a millionth of itself or, of an exact fit, of one or of what it was at first."""
    return _NOTICED * max(here.chi_square, min(1.0, first.chi_square)) + here.noise**2


def doubted(residuals: Residuals, here: Point, told: Told, dtype: Any, noticed: float) -> tuple[str, np.ndarray | None]:
    """Why a point is no minimum of chi^2, empty if it is one; and z where chi^2 is lower, if that is known.

    The Gauss-Newton matrix J^T J never has a negative eigenvalue.  The Hessian, here from differences of the gradient,
    has one at a saddle and at a maximum.
    """
    positive = np.asarray(residuals.parameters.positive)

    def settled(gain, step):  # at rest, and not on the way of a logarithm to infinity
        return gain <= noticed and bool(np.all(np.abs(step[positive]) < _FOLD))

    doubt = "" if settled(told.gain, told.step) else "chi^2 still falls there"
    misfit = max(float(np.linalg.norm(here.r)), 100 * here.noise)
    sizes = residuals.parameters.sizes
    scale = np.where(told.blind, np.where(sizes > 0, sizes, 1.0), misfit / np.maximum(here.sensitivity(), 1e-300))
    scale = np.where(positive, np.minimum(scale, 1 / _AROUND / 10), scale)
    gradient = here.J.T @ here.r
    around = [point(residuals, dtype, step) for step in np.diag(_AROUND * scale)]
    hessian = np.stack([(there.J.T @ there.r - gradient) * scale / _AROUND for there in around])
    if not np.all(np.isfinite(hessian)):
        return doubt, None
    curvature, directions = np.linalg.eigh((hessian + hessian.T) / 2)
    if curvature[0] < 0:
        way = scale * directions[:, 0] * misfit / np.sqrt(-curvature[0])
        folds = np.max(np.abs(way[positive]), initial=0.0)
        lengths = [_AROUND, 10 * _AROUND, *(_FOLDS / folds if folds else [])]
        tried = [sign * length * way for length in lengths for sign in (1, -1)]
        falls = [here.chi_square - point(residuals, dtype, z).chi_square for z in tried]
        best = int(np.nanargmax([*falls, noticed]))
        if best < len(tried):
            return "it met a saddle or a maximum of chi^2", tried[best]
    if curvature[0] < -BLIND * np.abs(curvature).max():
        return doubt, None
    stiff = curvature > BLIND * np.abs(curvature).max()
    along = (directions.T @ (scale * gradient))[stiff]
    newton = scale * (directions[:, stiff] @ (along / curvature[stiff]))
    return ("" if settled(float(along @ (along / curvature[stiff])), newton) else doubt), None


class Minimum(NamedTuple):
    """Where a search ended, and why that is no minimum; empty if it is one."""

    parameters: Parameters
    point: Point
    told: Told
    doubt: str
    steps: int


def minimised(residuals: Residuals, first: Point, dtype: Any, method: Any, max_steps: int) -> Minimum:
    """The minimum of chi^2 that `method` finds from here, in at most so many steps.

    Where it stops short of one, as solvers do that take a small step for a small error, it goes on with new scales.
    """
    # A minimiser learns the curvature on its way, and would lose it at the end of a leg.
    leg = max_steps if isinstance(method, optx.AbstractMinimiser) else _LEG
    here, steps, stuck, seeing = first, 0, False, None
    while True:
        progress.say(f"step {steps} of {max_steps} at most, chi^2 = {here.chi_square:.4g}")
        p, noticed, told = residuals.parameters, noticeable(here, first), told_at(residuals, here, dtype)
        seeing = ~told.blind if seeing is None else seeing
        doubt, way = "chi^2 still falls there", None
        if told.gain <= noticed or stuck or steps >= max_steps:
            doubt, way = doubted(residuals, here, told, dtype, noticed)
        if lost := " and ".join(name for name, x in zip(p.names, told.blind & seeing, strict=True) if x):
            doubt = f"{lost} went where the data no longer change with it"
        if not doubt or lost or steps >= max_steps or (stuck and way is None):
            break
        way, taken = (way, 1) if way is not None else searched(residuals, here, method, min(leg, max_steps - steps))
        moved = eqx.tree_at(lambda r: r.parameters, residuals, p.moved(jnp.asarray(way, residuals.data.dtype)))
        there, steps = point(moved, dtype), steps + taken
        stuck = not there.chi_square < here.chi_square - noticed
        if not there.finite:
            doubt = "the model is not finite where it went"
            break
        if there.chi_square < here.chi_square:
            residuals, here = moved, there
    return Minimum(p, here, told, doubt, steps)
