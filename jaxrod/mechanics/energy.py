"""Energies, each a pure function of generalized coordinates and rates that reads like its formula.

`body` is the rod's `Projection`; a and da are the strain amplitudes and their rates (n,).  All in J.
Equation numbers are those of Vikhrenko, Lasovsky, Tishevich (2013).
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..shapes.projection import Projection


def kinetic_rotation(
    body: Projection, a: Float[Array, " n"], da: Float[Array, " n"], dpsi: Float[Array, ""]
) -> Float[Array, ""]:
    """(4): K = 1/2 I (1 + eps)^2 psi'^2 + 1/2 I eps'^2."""
    return body.inertia(a) * dpsi**2 / 2 + _form(body.strain_mass, da) / 2


def kinetic_spherical(
    body: Projection,
    a: Float[Array, " n"],
    da: Float[Array, " n"],
    psi: Float[Array, ""],
    dpsi: Float[Array, ""],
    dphi: Float[Array, ""],
) -> Float[Array, ""]:
    """(8): K = 1/2 I eps'^2 + 1/2 I (1 + eps)^2 psi'^2 + 1/2 I (1 + eps)^2 phi'^2 cos^2 psi."""
    return body.inertia(a) * (dpsi**2 + dphi**2 * jnp.cos(psi) ** 2) / 2 + _form(body.strain_mass, da) / 2


def kinetic_director(
    body: Projection, a: Float[Array, " n"], da: Float[Array, " n"], dd: Float[Array, " D"]
) -> Float[Array, ""]:
    """(4) and (8) without angles: K = 1/2 z^T M z |d'|^2 + 1/2 a'^T M_aa a', for the director's rate d' (D,)."""
    return body.inertia(a) * (dd @ dd) / 2 + _form(body.strain_mass, da) / 2


def kinetic_embedded(body: Projection, dq: Float[Array, " D"]) -> Float[Array, ""]:
    """(4) and (8) in q = (1 + eps) d, where they are flat: K = 1/2 I |q'|^2."""
    return body.mass_matrix[0, 0] * (dq @ dq) / 2


def kinetic_momentum(body: Any, a: Float[Array, " n"], square: Float[Array, ""]) -> Float[Array, ""]:
    """Of turning, by the square of the angular momentum: K = l^2 / (2 z^T M z)."""
    return square / (2 * body.inertia(a))


def kinetic_center(body: Projection, dcenter: Float[Array, " D"]) -> Float[Array, ""]:
    """The first term of (6): 1/2 m v_C^2."""
    return body.mass * (dcenter @ dcenter) / 2


def elastic(body: Projection, a: Float[Array, " n"]) -> Float[Array, ""]:
    """The strain energy behind (15): 1/2 c l0^2 eps^2, in general 1/2 a^T K a; by another law int E A W(strain) ds."""
    if body.law is None:
        return _form(body.stiffness_matrix, a) / 2
    return body.rigidity @ body.law(body.field(a))


def elastic_embedded(body: Projection, q: Float[Array, " D"]) -> Float[Array, ""]:
    """The strain energy in q = (1 + eps) d: 1/2 c l0^2 (|q| - 1)^2, but for a constant.

    Multiplied out, 1/2 c l0^2 (|q|^2 - 2 |q|): its gradient, c l0^2 (1 - 1/|q|) q, is the shortest of all forces.
    """
    square = jnp.sum(q**2)
    if body.law is None:
        return body.stiffness_matrix[0, 0] * (square / 2 - jnp.sqrt(square))
    return body.rigidity @ body.law((jnp.sqrt(square) - 1)[None])


def gravity_embedded(body: Projection, g: Float[Array, " D"], q: Float[Array, " D"]) -> Float[Array, ""]:
    """(15), corrected, in q = (1 + eps) d: V = m g x_C q_y."""
    return body.first_moments[0] * _potential(g, q)


def gravity_pivoted(body: Any, g: Float[Array, " D"], a: Float[Array, " n"], d: Float[Array, " D"]) -> Float[Array, ""]:
    """(15), corrected: V = m g x_C (1 + eps) sin psi, zero at the pivot.  (The paper writes l0/2 for x_C.)"""
    return body.moment(a) * _potential(g, d)


def gravity_center(body: Projection, g: Float[Array, " D"], center: Float[Array, " D"]) -> Float[Array, ""]:
    """Weight of a rod in flight: V = m g y_C, zero at the origin."""
    return body.mass * _potential(g, center)


def _potential(g, x) -> Float[Array, ""]:
    """Of a unit mass at x: -g . x, of the vector of gravity (D,)."""
    return -g @ x


def _form(matrix, x) -> Any:
    """x^T matrix x; of a rigid rod, which has no x, nothing is computed."""
    return x @ matrix @ x if x.size else jnp.zeros((), x.dtype)
