"""Eigenproblems and factorisations of one matrix after another, with derivatives of any order.  Knows no rods.

A batched call of LAPACK blocks a thread of XLA's pool until other threads of it have done their share; two devices that
call at once wait for each other for ever (jaxlib 0.10 on CPUs).  Here a factorisation that is mapped over is a loop, and
the rule of each derivative multiplies matrices.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float, Inexact

_MEET = 1e3  # values nearer than so many roundings of the largest count as one

one_by_one = jax.custom_batching.sequential_vmap  # has no reverse derivative of its own


@one_by_one
def eigvalsh(a: Float[Array, "n n"]) -> Float[Array, " n"]:
    """Eigenvalues of a symmetric matrix, ascending, without a derivative."""
    return jnp.linalg.eigvalsh(a)


@jax.custom_jvp
def eigh(a: Float[Array, "n n"], b: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """a v = w b v with symmetric a and positive definite b: w (n,) ascending, v (n, n) in columns with v^T b v = 1.

    The sign of each v makes its largest component positive.  Forward and reverse derivatives are those of perturbation
    theory, in numbers scaled by a and b so that their size does not matter.  Of eigenvalues that meet, the derivatives
    hold together (their sum, any symmetric function of them), and vectors turn among themselves by convention not at
    all; where the perturbation keeps them together, each is right.
    """
    return _eigh(a, b)


@one_by_one
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


@one_by_one
def _lapack_eig(a):
    return jnp.linalg.eig(a)


@jax.custom_jvp
def _eig(a):
    """w and v, and u (n, n), in columns the shapes of the transposed matrix, with u^T v = 1."""
    w, v = _lapack_eig(a)
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


@one_by_one
def _svd(a):
    return jnp.linalg.svd(a, full_matrices=False)


@one_by_one
def _singular_values(a):
    return jnp.linalg.svd(a, compute_uv=False)


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def singular_values(a: Float[Array, "M N"], n: int) -> Float[Array, " n"]:
    """The n largest singular values, descending; their derivatives as of `svd`."""
    return _singular_values(a)[:n]


@singular_values.defjvp
def _singular_values_jvp(n, primals, tangents):
    (a,), (da,) = primals, tangents
    u, sigma, v = svd(a, n)
    return sigma, jnp.sum(u * (da @ v), axis=0)


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def svd(a: Float[Array, "M N"], n: int) -> tuple[Float[Array, "M n"], Float[Array, " n"], Float[Array, "N n"]]:
    """The n largest singular values with their vectors in columns: u, sigma, v with a v = u sigma.

    Derivatives are those of perturbation theory.  Of values that meet, such as zeros, the derivatives hold together, and
    vectors do not turn among themselves.
    """
    u, sigma, vt = _svd(a)
    return u[:, :n], sigma[:n], vt[:n].T


@svd.defjvp
def _svd_jvp(n, primals, tangents):
    (a,), (da,) = primals, tangents
    u, sigma, v = svd(a, min(a.shape))
    un, sn, vn = u[:, :n], sigma[:n], v[:, :n]
    on_v, on_u = da @ vn, da.T @ un
    left, right = u.T @ on_v, v.T @ on_u
    gap = (sn[None, :] - sigma[:, None]) * (sn[None, :] + sigma[:, None])
    meet = jnp.abs(sn[None, :] - sigma[:, None]) <= _MEET * jnp.finfo(sigma.dtype).eps * sigma[0]
    gap = jnp.where(meet, 1.0, gap)
    du = u @ jnp.where(meet, 0.0, (left * sn[None, :] + sigma[:, None] * right) / gap)
    dv = v @ jnp.where(meet, 0.0, (right * sn[None, :] + sigma[:, None] * left) / gap)
    inverse = jnp.where(sn > 0, 1 / jnp.where(sn > 0, sn, 1.0), 0.0)[None, :]
    # What leaves the space of the vectors, of which the longer side has more.
    du = du + (on_v - u @ left) * inverse if a.shape[0] > a.shape[1] else du
    dv = dv + (on_u - v @ right) * inverse if a.shape[1] > a.shape[0] else dv
    return (un, sn, vn), (du, jnp.diagonal(left), dv)


@jax.custom_jvp
def pinv(a: Inexact[Array, "M N"]) -> Inexact[Array, "N M"]:
    """The pseudo-inverse; derivatives as long as the rank stays (Golub, Pereyra 1973)."""
    return _pinv(a)


@one_by_one
def _pinv(a):
    return jnp.linalg.pinv(a, rtol=float(jnp.finfo(a.dtype).eps) ** 0.75)


@pinv.defjvp
def _pinv_jvp(primals, tangents):
    (a,), (da,) = primals, tangents
    p, across = pinv(a), da.conj().T
    left, right = jnp.eye(a.shape[0], dtype=a.dtype) - a @ p, jnp.eye(a.shape[1], dtype=a.dtype) - p @ a
    return p, -p @ da @ p + p @ (p.conj().T @ across @ left) + (right @ across @ p.conj().T) @ p


@jax.custom_jvp
def inverse_root(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """W, upper triangular, with W W^T the inverse of a positive definite matrix; NaN of another (Cholesky fails)."""
    return _inverse_root(a)


@one_by_one
def _inverse_root(a):
    lower = jnp.linalg.cholesky(a)
    return jax.scipy.linalg.solve_triangular(lower, jnp.eye(a.shape[0], dtype=a.dtype), lower=True).T


@inverse_root.defjvp
def _inverse_root_jvp(primals, tangents):
    (a,), (da,) = primals, tangents
    w = inverse_root(a)
    inside = w.T @ ((da + da.T) / 2) @ w
    return w, -w @ (jnp.triu(inside) - jnp.diag(jnp.diagonal(inside)) / 2)


class OneByOne(lx.AbstractLinearSolver):
    """A solver of Lineax's that may be mapped over: by the inverse, of a matrix that is not square the pseudo-inverse."""

    def init(self, operator, options):
        del options
        a = operator.as_matrix()
        inverse = _inverse(a) if a.shape[0] == a.shape[1] else pinv(a)
        structures = (operator.in_structure(), operator.out_structure())
        return inverse, *jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), structures)

    def compute(self, state, vector, options):
        del options
        inverse, unknowns, _ = state
        solution = ravel_pytree(unknowns)[1](inverse @ ravel_pytree(vector)[0])
        return solution, lx.RESULTS.successful, {}

    def transpose(self, state, options):
        inverse, unknowns, equations = state
        return (inverse.T, equations, unknowns), options

    def conj(self, state, options):
        inverse, *zeros = state
        return (inverse.conj(), *zeros), options

    def assume_full_rank(self):
        return True


@one_by_one
def _inverse(a):
    return jnp.linalg.inv(a)


def mappable(tree: Any) -> Any:
    """The tree with the direct solvers of Lineax in it, which factorise in batches, replaced by `OneByOne`."""
    direct = lx.AutoLinearSolver | lx.LU | lx.QR | lx.SVD | lx.Cholesky
    return jax.tree.map(
        lambda x: OneByOne() if isinstance(x, direct) else x,
        tree,
        is_leaf=lambda x: isinstance(x, lx.AbstractLinearSolver),
    )
