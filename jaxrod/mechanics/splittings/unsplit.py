"""The equations of motion uncut, as `Unrolled` steps them."""

import functools

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core.each_lane import lanewise
from ...integrators.splitting import AbstractStepper, PhasePoint
from ..chart import Director, Embedded, Strains
from ..equations import Condensed, DiscreteSystem, Moving, eigenvalues
from ..system import System
from .common import lowest, watched


class UnsplitStepper(AbstractStepper):
    """The equations of motion uncut, for `Unrolled`: q and v of a chart."""

    equations: Moving | Condensed
    field: Float[Array, "n places"]

    def __init__(self, system: System, scene: DiscreteSystem):
        flat = Embedded() if system.flat else Director()
        self.equations = system.equations(Strains() if system.motion.prescribed else flat, scene)
        self.field = watched(scene.body.strains)

    def encode(self, state):
        return PhasePoint(*self.equations.encode(0.0, state))

    def decode(self, t, y, turns):
        return self.equations.decode(t, y.q, y.p, turns)

    def table(self, scheme, h):
        del scheme, h

    def step(self, scheme, table, t, h, y):
        tableau = scheme.method.tableau
        rates = [self._rate(t, y)]
        for c, row in zip(tableau.c, tableau.a_lower, strict=True):
            rates.append(self._rate(t + float(c) * h, _ahead(y, h, row, rates)))
        return _ahead(y, h, tableau.b_sol, rates)

    def _rate(self, t, y: PhasePoint) -> PhasePoint:
        return PhasePoint(y.p, lanewise(_acceleration)(self.equations, t, y.q, y.p))

    def longest_step(self, scheme, spin):
        # Two steps a period at least: no explicit method follows a vibration that it does not see.
        del scheme, spin
        body = self.equations.scene.body
        if isinstance(self.equations, Condensed) or not body.stiffness_matrix.size:
            return jnp.inf
        return jnp.pi / jnp.sqrt(eigenvalues(body)[-1])

    def heading(self, y):
        size = self.equations.chart.size(self.equations.scene.motion)
        return y.q[:size] if size else None

    def lowest_strain(self, phases):
        return functools.reduce(jnp.minimum, [self._lowest(y) for y in phases])

    def _lowest(self, y: PhasePoint):
        size, n = self.equations.chart.size(self.equations.scene.motion), self.field.shape[0]
        if isinstance(self.equations.chart, Embedded):
            return jnp.sqrt(jnp.sum(y.q[:size] ** 2, axis=0)) - 1
        if n == 0 or isinstance(self.equations, Condensed):
            return jnp.zeros_like(y.q[0])
        return lowest(y.q[size : size + n], self.field)


def _acceleration(equations: Moving | Condensed, t, q, v):
    return equations.acceleration(t, q, v)


def _ahead(y: PhasePoint, h, weights, rates: list[PhasePoint]) -> PhasePoint:
    q, p = y.q, y.p
    for weight, rate in zip(weights, rates, strict=False):
        if weight:
            q, p = q + float(weight) * h * rate.q, p + float(weight) * h * rate.p
    return PhasePoint(q, p)
