"""Oscillators for the axial modes, whatever their number and stiffness."""

import abc
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core import precision
from ...core.linear_algebra import eigh
from ...integrators.splitting import AbstractSplitting, PhasePoint
from ...motions.state import State
from ...shapes.projection import Projection
from .common import lowest, per_inertia


class AxialModes(eqx.Module):
    """The rod in its axial normal modes, per inertia: amplitudes eta with a = shapes @ eta, of mass 1.

    `rates` (n,), natural angular frequencies in rad/s, `periods` (n,) one over them; `arms` (n,) and `rest`: the moment of
    inertia is rest + |arms + eta|^2, which is 1 at rest; `moments` (n+1,) the first moments; `shapes` (n, n), `inverse` its
    inverse.
    """

    rates: Float[Array, " n"]
    periods: Float[Array, " n"]
    arms: Float[Array, " n"]
    rest: Float[Array, ""]
    moments: Float[Array, " all"]
    shapes: Float[Array, "n n"]
    inverse: Float[Array, "n n"]

    def __init__(self, body: Projection):
        dtype = body.mass_matrix.dtype
        # In the widest type there is: of the fastest modes float32 would lose (omega_k / omega_1)^2 times its rounding.
        body = per_inertia(precision.in_type(jnp.result_type(float), body))
        n = body.stiffness_matrix.shape[0]
        mixed = body.mass_matrix[1:, 0]
        if n == 0:
            squares, shapes = jnp.zeros_like(mixed), body.stiffness_matrix
        else:
            # By compliances, 1 / omega^2: rounding is small beside the largest, which are those of the slowest modes.
            compliances, shapes = eigh(body.strain_mass, body.stiffness_matrix)
            squares, shapes = 1 / compliances[::-1], (shapes / jnp.sqrt(compliances)[None, :])[:, ::-1]
        rates, inverse, arms = jnp.sqrt(squares), shapes.T @ body.strain_mass, shapes.T @ mixed
        moments = jnp.concatenate([body.first_moments[:1], shapes.T @ body.first_moments[1:]])
        found = (rates, 1 / rates, arms, 1 - arms @ arms, moments, shapes, inverse)
        self.rates, self.periods, self.arms, self.rest, self.moments, self.shapes, self.inverse = precision.in_type(
            dtype, found
        )

    def inertia(self, eta):
        """Moment of inertia of the stretched rod."""
        arms = self.arms + eta
        return self.rest + arms @ arms

    def moment(self, eta):
        """First moment of the stretched rod."""
        return self.moments[0] + self.moments[1:] @ eta

    def encode(self, state: State) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """eta of a state, and its rates over the natural ones."""
        return self.inverse @ state.amplitudes, self.inverse @ state.amplitude_rates / self.rates

    def decode(self, eta, deta) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The amplitudes of the strain, and their rates."""
        return self.shapes @ eta, self.shapes @ (deta * self.rates)


class AbstractModalSplitting(AbstractSplitting):
    """A split whose drift has the oscillators of the axial modes.

    `field`: strain of each mode at the places watched.
    """

    modes: eqx.AbstractVar[AxialModes]
    field: eqx.AbstractVar[Float[Array, "n places"]]

    def table(self, scheme, h):
        """Versine and sine of each oscillator's angle in the drift of each stage, and in the first drift."""
        drifts = jnp.asarray([stage.drift for stage in scheme.stages], self.modes.rest.dtype)
        circle = jax.lax.stop_gradient(jax.vmap(lambda drift: self._circle(drift * h))(drifts))
        return circle, jax.lax.stop_gradient(self._circle(scheme.drifts[0] * h))

    def _circle(self, t):
        angles = self.modes.rates * t
        # By 1 - cos: the rounding of a cosine near one would swell or shrink the oscillation, alike in every step.
        return 2 * jnp.sin(angles / 2) ** 2, jnp.sin(angles)

    def _turned(self, circle, t):
        """A known circle of time t, as the function of the rates and of t that it is."""
        return _on_circle(*circle, self.modes.rates * t)

    @abc.abstractmethod
    def _drift(self, circle, t, y: PhasePoint) -> PhasePoint:
        """y after a drift for a time t, in which the oscillators turn as `circle` knows."""

    def enter(self, scheme, table, t, h, y):
        del t
        return self._drift(table[1], scheme.drifts[0] * h, y)

    def leave(self, scheme, table, t, h, y):
        del t
        return self.normalized(self._drift(back(table[1]), -scheme.drifts[0] * h, y))

    def _kicked(self, h, push: Float[Array, "n lanes"], y: PhasePoint) -> PhasePoint:
        """y after a force on each mode for a time h."""
        return y._replace(strain_momentum=y.strain_momentum + h * push * self.modes.periods)

    def lowest_strain(self, phases):
        if not self.field.size:
            return jnp.zeros_like(phases[0].q[0])
        return functools.reduce(jnp.minimum, [lowest(y.strain, self.field) for y in phases])


def back(circle):
    """The same angles backwards."""
    versine, sin = circle
    return versine, -sin


@jax.custom_jvp
def _on_circle(versine, sin, angle):
    """1 - cos(angle) and sin(angle), which are known."""
    del angle
    return versine, sin


@_on_circle.defjvp
def _along_circle(known, rates):
    versine, sin = _on_circle(*known)
    return (versine, sin), (sin * rates[2], (1 - versine) * rates[2])
