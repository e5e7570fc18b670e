"""Explicit Runge-Kutta methods written out number by number, for scenes whose forces depend on rates."""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp

from ...core import validation
from ...core.scalarize import by_number, gathered, scattered
from ...motions.motion import Driven
from ..chart import Director, Embedded, Strains
from ..equations import Condensed, Moving, eigenvalues
from ..system import System
from .common import AbstractStepped, Split, least, lowest, watched


class Unrolled(diffrax.AbstractSolver):
    """An explicit Runge-Kutta method of Diffrax by equal steps, all in one compiled loop: for sweeps with friction.

    Diffrax's own loop over the stages, and its step size control, are launched piece by piece.  Forward derivatives take
    `adjoint=diffrax.ForwardMode()`; for reverse ones `adjoint=diffrax.RecursiveCheckpointAdjoint()` has Diffrax run it.

    **Arguments:** `method`, one of Diffrax's explicit Runge-Kutta solvers.  Give `simulate` its `n_steps` too.

    **Raises:** `ValueError` for another method.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81, forces=[jaxrod.PivotFriction(0.1)])
    >>> print(jaxrod.simulate(system, system.state(), t1=1.0, solver=jaxrod.Unrolled(), n_steps=2000).angle.round(6))
    [-3.022056]
    """

    method: Any = eqx.field(default_factory=diffrax.Tsit5)

    def __check_init__(self):
        if not isinstance(self.method, diffrax.AbstractERK):
            raise ValueError(
                f"Unrolled(method={validation.given(self.method)}) is no explicit Runge-Kutta method; give diffrax.Tsit5()."
            )

    # By Diffrax itself it is the method as it is.

    @property
    def term_structure(self) -> Any:
        return self.method.term_structure

    @property
    def interpolation_cls(self) -> Any:
        return self.method.interpolation_cls

    def order(self, terms):
        return self.method.order(terms)

    def init(self, terms, t0, t1, y0, args):
        return self.method.init(terms, t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        return self.method.step(terms, t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.method.func(terms, t0, y0, args)


class Whole(AbstractStepped):
    """The equations of motion uncut, for `Unrolled`: q and v of a chart."""

    equations: Moving | Condensed
    numbers: Any
    field: Any

    def __init__(self, system: System):
        flat = Embedded() if system.flat else Director()
        self.equations = system.equations(Strains() if isinstance(system.motion, Driven) else flat)
        self.numbers = scattered(self.equations)
        self.field = scattered(watched(system.body.strains))

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
