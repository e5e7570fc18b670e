"""Lagrange's equations from a Lagrangian, by automatic differentiation.  Knows no rods.

d/dt (dL/dv) = dL/dq + Q      with momentum p = dL/dv and mass matrix M = dp/dv:
M v' = dL/dq + Q - dp/dt|_v - (dp/dq) v
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import calling, tracing, validation
from ..motions.signal import on_clock

_UNROLLED = 6


class Phase(NamedTuple):
    """Generalized coordinates q (N,) and velocities v (N,)."""

    q: Float[Array, "*batch N"]
    v: Float[Array, "*batch N"]


class Lagrangian(eqx.Module):
    """A mechanical system that is nothing but its Lagrangian.

    **Arguments:** `function`, (t, q, v) -> L in J, of coordinates q and velocities v of shape (N,), with a positive
    definite mass matrix d^2 L / dv^2; `force`, (t, q, v) -> generalized forces (N,), or None; and `solve`, (t, q, b) ->
    M^-1 b where the inverse of the mass matrix is known in closed form, or None.

    >>> import jax.numpy as jnp, jaxrod
    >>> pendulum = jaxrod.Lagrangian(lambda t, q, v: v @ v / 2 + jnp.cos(q[0]))
    >>> print(pendulum.acceleration(0.0, jnp.array([jnp.pi / 2]), jnp.zeros(1)))
    [-1.]
    """

    function: Callable[..., Float[Array, ""]]
    force: Callable[..., Float[Array, " N"]] | None
    solve: Callable[..., Float[Array, " N"]] | None

    def __init__(
        self,
        function: Callable[..., Any],
        force: Callable[..., Any] | None = None,
        solve: Callable[..., Any] | None = None,
    ):
        for name, value in (("function", function), ("force", force), ("solve", solve)):
            if not callable(value) and not (value is None and name != "function"):
                raise ValueError(
                    f"Lagrangian({name}={validation.given(value)}) is not a function; give one, such as "
                    "lambda t, q, v: v @ v / 2."
                )
        self.function = tracing.carried(function)
        self.force = None if force is None else tracing.carried(force)
        self.solve = None if solve is None else tracing.carried(solve)

    def delayed(self, t0: Float[Array, ""]) -> "Lagrangian":
        """The same system on a clock that shows zero at t0 (s)."""
        force, solve = (None if f is None else _Delayed(f, t0) for f in (self.force, self.solve))
        return Lagrangian(_Delayed(self.function, t0), force, solve)

    def loads(self, start: Phase) -> list[tuple[bool, Callable[[Any], Array]]]:
        """Its accelerations as a function of time at the start, if they are one: as of `DiscreteSystem.loads`."""
        if not tracing.depends_on_first(self.acceleration, jnp.zeros((), start[0].dtype), *start):
            return []
        return [(True, lambda t: self.acceleration(t, *start))]

    def gained(self, start: Phase, instants: Float[Array, " T"], pushes: list) -> Float[Array, ""]:
        """Nothing: it has no rate of its own to measure by."""
        del start, pushes
        return jnp.zeros_like(instants[0])

    def unseen(self, times: Float[Array, " T"], start: Phase) -> Bool[Array, ""]:
        """Of any Lagrangian nobody knows."""
        del times, start
        return jnp.asarray(False)

    def check(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> None:
        """Refuse, by `ValueError`, coordinates that are not alike, and functions that fail for them.

        Nothing is computed.
        """
        q, v = validation.reals("q", q), validation.reals("v", v)
        if q.shape != v.shape or q.ndim != 1 or q.size == 0:
            raise ValueError(
                f"q has shape {q.shape} and v has shape {v.shape}; give (N,) coordinates and as many velocities, N at least 1."
            )
        calling.tried(
            "Lagrangian(function=)", "(t, q, v) -> energy in J, one number", self.function, t, q, v, shapes=[()]
        )
        if self.force is not None:
            calling.tried(
                "Lagrangian(force=)", "(t, q, v) -> generalized forces (N,)", self.force, t, q, v, shapes=[q.shape]
            )
        if self.solve is not None:
            calling.tried("Lagrangian(solve=)", "(t, q, b) -> M^-1 b, (N,)", self.solve, t, q, v, shapes=[q.shape])

    def _check_known(self, t, q, v):
        if tracing.known(q) and tracing.known(v):
            self.check(t, q, v)

    def momentum(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """p = dL/dv."""
        self._check_known(t, q, v)
        return jax.grad(self.function, argnums=2)(t, q, v)

    def mass_matrix(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, "N N"]:
        """M = d^2 L / dv^2."""
        self._check_known(t, q, v)
        return jax.jacfwd(self.momentum, argnums=2)(t, q, v)

    def acceleration(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
        """v' from Lagrange's equations."""
        self._check_known(t, q, v)
        push = jax.grad(self.function, argnums=1)(t, q, v)
        if self.force is not None:
            push = push + self.force(t, q, v)
        t = jnp.asarray(t, dtype=q.dtype)
        _, carried = jax.jvp(lambda t, q: self.momentum(t, q, v), (t, q), (jnp.ones_like(t), v))
        if self.solve is not None:
            return self.solve(t, q, push - carried)
        return solve_positive(self.mass_matrix(t, q, v), push - carried)

    def energy(self, t: Any, q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, ""]:
        """H = p v - L, in J."""
        self._check_known(t, q, v)
        return self.momentum(t, q, v) @ v - self.function(t, q, v)


class _Delayed(eqx.Module):
    """A function of (t, q, v) on a clock that shows zero at t0."""

    function: Any
    t0: Float[Array, ""]

    def __call__(self, t, q, v):
        return on_clock(lambda t: self.function(t, q, v), self.t0, t)


def solve_positive(matrix: Float[Array, "N N"], right: Float[Array, " N"]) -> Float[Array, " N"]:
    """x with matrix @ x = right, for a symmetric positive definite matrix, without a call of LAPACK.

    Small ones by Cholesky's factorisation written out, which is the fastest on CPUs; others by elimination of columns.
    """
    size = right.shape[0]
    if size > _UNROLLED:
        return eliminate(matrix, right)
    lower = [[right[0]] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j] - sum(lower[i][k] * lower[j][k] for k in range(j))
            lower[i][j] = jnp.sqrt(rest) if i == j else rest / lower[j][j]
    x = [right[i] for i in range(size)]
    for i in range(size):
        x[i] = (x[i] - sum(lower[i][k] * x[k] for k in range(i))) / lower[i][i]
    for i in reversed(range(size)):
        x[i] = (x[i] - sum(lower[k][i] * x[k] for k in range(i + 1, size))) / lower[i][i]
    return jnp.stack(x)


def eliminate(matrix, right: Float[Array, " N"]):
    """x with matrix @ x = right by Gauss and Jordan, without pivoting: after step k column k is that of the identity."""
    table = jnp.concatenate([matrix, right[:, None]], axis=1)
    for k in range(right.shape[0]):
        row = table[k] / table[k, k]
        table = (table - table[:, k, None] * row[None, :]).at[k].set(row)
    return table[:, -1]
