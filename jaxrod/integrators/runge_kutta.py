"""Explicit Runge-Kutta methods by equal steps, for scenes whose forces depend on rates."""

from typing import Any

import diffrax
import equinox as eqx

from ..core import validation


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

    def order(self, terms: Any):
        return self.method.order(terms)

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any):
        return self.method.init(terms, t0, t1, y0, args)

    def step(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: Any, made_jump: Any):
        return self.method.step(terms, t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms: Any, t0: Any, y0: Any, args: Any):
        return self.method.func(terms, t0, y0, args)
