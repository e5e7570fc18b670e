"""The equations of motion uncut, number by number, as `Unrolled` steps them."""

from typing import Any

import jax.numpy as jnp

from ...core.scalarize import by_number, gathered, scattered
from ...integrators.splitting import AbstractStepped, Split
from ..chart import Director, Embedded, Strains
from ..equations import Condensed, DiscreteSystem, Moving, eigenvalues
from ..system import System
from .common import least, lowest, watched


class Whole(AbstractStepped):
    """The equations of motion uncut, for `Unrolled`: q and v of a chart."""

    equations: Moving | Condensed
    numbers: Any
    field: Any

    def __init__(self, system: System, scene: DiscreteSystem):
        flat = Embedded() if system.flat else Director()
        self.equations = system.equations(Strains() if system.motion.prescribed else flat, scene)
        self.numbers = scattered(self.equations)
        self.field = scattered(watched(scene.body.strains))

    def encode(self, state):
        q, v = self.equations.encode(0.0, state)
        return Split(scattered(q), scattered(v))

    def decode(self, t, y, turns):
        return self.equations.decode(t, gathered(y.q), gathered(y.p), turns)

    def table(self, scheme, h):
        del scheme, h

    def step(self, scheme, table, t, h, y):
        tableau = scheme.method.tableau
        rates = [self._rate(t, y)]
        for c, row in zip(tableau.c, tableau.a_lower, strict=True):
            rates.append(self._rate(t + float(c) * h, _ahead(y, h, row, rates)))
        return _ahead(y, h, tableau.b_sol, rates)

    def _rate(self, t, y: Split) -> Split:
        return Split(y.p, by_number(_acceleration)(self.numbers, t, y.q, y.p))

    def longest_step(self, scheme, ts):
        # Two steps a period at least: no explicit method follows a vibration that it does not see.
        del scheme, ts
        body = self.equations.scene.body
        if isinstance(self.equations, Condensed) or not body.stiffness_matrix.size:
            return jnp.inf
        return jnp.pi / jnp.sqrt(eigenvalues(body)[-1])

    def heading(self, y):
        size = self.equations.chart.size(self.equations.scene.motion)
        return y.q[:size] if size else None

    def lowest_strain(self, phases):
        return least(self._lowest(y) for y in phases)

    def _lowest(self, y: Split):
        size, n = self.equations.chart.size(self.equations.scene.motion), self.field.shape[0]
        if isinstance(self.equations.chart, Embedded):
            return jnp.sqrt(sum(x * x for x in y.q[:size])) - 1
        if n == 0 or isinstance(self.equations, Condensed):
            return jnp.zeros_like(y.q[0])
        return lowest(y.q[size : size + n], self.field)


def _acceleration(equations: Moving | Condensed, t, q, v):
    return equations.acceleration(t, q, v)


def _ahead(y: Split, h, weights, rates: list[Split]) -> Split:
    q, p = y.q, y.p
    for weight, rate in zip(weights, rates, strict=False):
        if weight:
            q, p = q.moved(float(weight) * h, rate.q), p.moved(float(weight) * h, rate.p)
    return Split(q, p)
