"""Eigenproblems with derivatives that stay finite where eigenvalues meet.  Knows no rods."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from . import linear_algebra
from .linear_algebra import pinv

_MEET = 1e3  # eigenvalues nearer than so many roundings of the largest count as one


@jax.custom_jvp
def eigh(a: Float[Array, "n n"], b: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """a v = w b v with symmetric a and positive definite b: w (n,) ascending, v (n, n) in columns with v^T b v = 1.

    The sign of each v makes its largest component positive.  Forward and reverse derivatives are those of perturbation
    theory, in numbers scaled by a and b so that their size does not matter.  Of eigenvalues that meet, the derivatives
    hold together (their sum, any symmetric function of them), and vectors turn among themselves by convention not at
    all; where the perturbation keeps them together, each is right.
    """
    return _eigh(a, b)


@linear_algebra.one_by_one
def _eigh(a, b):
    # Scaled to one by size, so that neither overflows.
    scale_a, scale_b = jnp.max(jnp.abs(a)), jnp.max(jnp.abs(b))
    lower = jnp.linalg.cholesky(b / scale_b)
    half = jax.scipy.linalg.solve_triangular(lower, a / scale_a, lower=True)
    whole = jax.scipy.linalg.solve_triangular(lower, half.T, lower=True)
    w, y = jnp.linalg.eigh((whole + whole.T) / 2)
    v = jax.scipy.linalg.solve_triangular(lower, y, lower=True, trans=1)
    largest = jnp.take_along_axis(v, jnp.argmax(jnp.abs(v), axis=0)[None, :], axis=0)
    return w * (scale_a / scale_b), v * jnp.where(largest < 0, -1.0, 1.0) / jnp.sqrt(scale_b)


@eigh.defjvp
def _eigh_jvp(primals, tangents):
    (a, b), (da, db) = primals, tangents
    w, v = eigh(a, b)
    in_a, in_b = v.T @ da @ v, v.T @ db @ v
    gap = w[None, :] - w[:, None]
    meet = jnp.abs(gap) <= _MEET * jnp.finfo(w.dtype).eps * jnp.max(jnp.abs(w))
    mixing = (in_a - in_b * w[None, :]) / jnp.where(meet, 1.0, gap)
    dv = v @ jnp.where(meet, -in_b / 2, mixing)
    return (w, v), (jnp.diagonal(in_a) - w * jnp.diagonal(in_b), dv)


def eig(a: Float[Array, "n n"]) -> tuple[Complex[Array, " n"], Complex[Array, "n n"]]:
    """a v = w v for any real a: w (n,) and v (n, n) in columns, each up to a factor.

    Derivatives as of `eigh`: finite where eigenvalues meet, and then right for them together.
    """
    w, v, _ = _eig(a)
    return w, v


@jax.custom_jvp
def _eig(a):
    """w and v, and u (n, n), in columns the shapes of the transposed matrix, with u^T v = 1."""
    w, v = linear_algebra.eig(a)
    # A step of Newton's: beside a double eigenvalue LAPACK's shapes of the others have half the digits.
    v = v + _turned(a, w, v.conj(), v * w[None, :] - a @ v)
    return w, v, pinv(v).T


@_eig.defjvp
def _eig_jvp(primals, tangents):
    (a,), (da,) = primals, tangents
    w, v, u = _eig(a)
    dw = jnp.sum(u * (da @ v), axis=0)
    dv = _turned(a, w, v.conj(), v * dw[None, :] - da @ v)
    du = _turned(a.T, w, v, u * dw[None, :] - da.T @ u, -jnp.sum(u * dv, axis=0))
    return (w, v, u), (dw, dv, du)


def _turned(a, w, along, load, beside: Any = 0.0):
    """d, column by column, with (a - w) d = load and along . d = beside.

    Each by its own equations: a sum over the other shapes breaks down where two of them are one, as of a rod that turns
    freely.
    """

    def turn(w, along, load, beside):
        equations = jnp.concatenate([a - w * jnp.eye(a.shape[0]), along[None, :]])
        return pinv(equations) @ jnp.append(load, beside)

    beside = jnp.broadcast_to(beside, w.shape)
    return jax.vmap(turn, in_axes=(0, 1, 1, 0), out_axes=1)(w, along, load, beside)
