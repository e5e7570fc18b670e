"""Symplectic solvers: symmetric compositions of drift and kick, from lists of coefficients with their sources.

Each is a Diffrax solver for the term that `System.split` makes, of fixed steps; saving, events and progress meters are
Diffrax's.  Inside a step the state is that of the same method with a shorter step, so dense output is of full order.
"""

import functools
from typing import Any, ClassVar, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..core.lanes import alone, laned, spread
from .splitting import AbstractSplitting, Stage


class SplitTerm(diffrax.AbstractTerm):
    """The term that carries a split to its solver.  As a vector field it is the rate of change along all flows."""

    split: AbstractSplitting

    def vf(self, t, y, args):
        del args
        h = jnp.zeros_like(jnp.asarray(t))
        return jax.jvp(lambda h: single_step(StormerVerlet(), self.split, t, h, y), (h,), (jnp.ones_like(h),))[1]

    def contr(self, t0, t1, **kwargs):
        return t1 - t0

    def prod(self, vf, control):
        return jax.tree.map(lambda x: x * control, vf)

    def vf_prod(self, t, y, args, control):
        if isinstance(control, Stride):  # Diffrax wraps terms, and this goes through
            return single_step(control.solver, self.split, t, control.h, y)
        return self.prod(self.vf(t, y, args), control)


class Stride(NamedTuple):
    """A step of a symplectic solver, asked of a term."""

    solver: Any
    h: Any


class AbstractSymplectic(diffrax.AbstractSolver):
    """drift(a_0 h) kick(b_1 h) drift(a_1 h) ... kick(b_s h) drift(a_s h), the same backwards."""

    term_structure: ClassVar = SplitTerm

    accuracy: ClassVar[int]  # its order
    small_kicks: ClassVar[bool] = False  # whether it is made for splits whose kicks are small
    needs_nystrom: ClassVar[bool] = False  # whether the order holds for Runge-Kutta-Nystrom splits alone
    first_drifts: ClassVar[tuple[float, ...]]  # the first half; a last one is set so that all make 1
    first_kicks: ClassVar[tuple[float, ...]]

    @property
    def drifts(self) -> tuple[float, ...]:
        """a_0 .. a_s."""
        return _whole(self.first_drifts, self._stages + 1)

    @property
    def kicks(self) -> tuple[float, ...]:
        """b_1 .. b_s."""
        return _whole(self.first_kicks, self._stages)

    @property
    def stable_phase(self) -> float:
        """The longest step, as the angle of an oscillator cut into its inertia and its spring, at which nothing grows."""
        return _stable_phase(self.drifts, self.kicks)

    @property
    def _stages(self) -> int:
        return len(self.first_drifts) + len(self.first_kicks) + 1

    @property
    def stages(self) -> list[Stage]:
        """What a step does; its last drift goes on into the next step's first."""
        drifts, passed, before, found = self.drifts, 0.0, self.drifts[0], []
        for ahead, kick, drift, joined in zip(
            drifts, self.kicks, drifts[1:], (*drifts[1:-1], 2 * drifts[0]), strict=False
        ):
            passed += ahead
            found.append(Stage(passed, before, kick - before, joined))
            before = drift - (kick - before)
        return found

    @property
    def interpolation_cls(self):
        return ShorterStep

    def order(self, terms):
        return self.accuracy

    def init(self, terms, t0, t1, y0, args):
        return None

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        del made_jump
        y1 = terms.vf_prod(t0, y0, args, Stride(self, terms.contr(t0, t1)))
        return y1, None, {"y0": y0, "terms": terms, "solver": self}, solver_state, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)


def single_step(solver: AbstractSymplectic, split: AbstractSplitting, t, h, y):
    """A step of one scene, from y to y."""

    @laned
    def step(split, t, h, y):
        return split.whole_step(solver, split.table(solver, h), t, h, y)

    return alone(step(*spread((split, t, h, y))))


class ShorterStep(diffrax.AbstractLocalInterpolation):
    """Between t0 and t1: a step of the solver from t0 that ends there."""

    t0: Any
    t1: Any
    y0: Any
    terms: diffrax.AbstractTerm
    solver: AbstractSymplectic

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda b, a: b - a, self.evaluate(t1), self.evaluate(t0))
        return self.terms.vf_prod(self.t0, self.y0, None, Stride(self.solver, self.terms.contr(self.t0, t0)))


class StormerVerlet(AbstractSymplectic):
    """Order 2, one kick: half a drift, kick, half a drift.  For stiff rods and few digits; takes `n_steps`.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=2e11, density=7800.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(3), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=1.0, solver=jaxrod.StormerVerlet(), n_steps=3000)
    >>> print(sol.angle.round(4))
    [14.8416]
    """

    accuracy: ClassVar = 2
    first_drifts: ClassVar = ()
    first_kicks: ClassVar = ()


class BlanesMoan4(AbstractSymplectic):
    """Order 4, six kicks.  Blanes, Moan (2002), J. Comput. Appl. Math. 142, 313: S6."""

    accuracy: ClassVar = 4
    first_drifts: ClassVar = (0.0792036964311957, 0.353172906049774, -0.0420650803577195)
    first_kicks: ClassVar = (0.209515106613362, -0.143851773179818)


class BlanesMoan6(AbstractSymplectic):
    """Order 6, fourteen kicks, for Runge-Kutta-Nystrom splits: uniform strain, rigid and driven rods, whose default it is.

    Blanes, Moan (2002): SRKN14a.  Its steps are counted by `tolerance`, or given:

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=1.0, solver=jaxrod.BlanesMoan6(), n_steps=175)
    >>> print(sol.angle.round(4))
    [14.601]
    """

    accuracy: ClassVar = 6
    needs_nystrom: ClassVar = True
    first_drifts: ClassVar = (
        0.0378593198406116, 0.102635633102435, -0.0258678882665587, 0.314241403071447, -0.130144459517415,
        0.106417700369543, -0.00879424312851058,
    )  # fmt: skip
    first_kicks: ClassVar = (
        0.09171915262446165, 0.183983170005006, -0.05653436583288827, 0.004914688774712854, 0.143761127168358,
        0.328567693746804,
    )  # fmt: skip


class ABA864(AbstractSymplectic):
    """Seven kicks, for splits whose kicks are small: orders 8, 6, 4 in their first, second and higher powers.

    The one for stiff rods, uniform strain or not: it splits them as `FreeRotationSplitting`, and its steps may be longer than
    an axial period.  Blanes, Casas, Farres, Laskar, Makazaga, Murua (2013), Appl. Numer. Math. 68, 58: ABA864.  Its steps are
    counted by `tolerance`, which resolves each axial period, or given:

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=2e11, density=7800.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=1.0, solver=jaxrod.ABA864(), n_steps=800)
    >>> print(sol.angle.round(4))
    [14.8416]
    """

    accuracy: ClassVar = 4
    small_kicks: ClassVar = True
    first_drifts: ClassVar = (0.07113342649822312, 0.2411534279566401, 0.5214117617728147)
    first_kicks: ClassVar = (0.18308368747219722, 0.3107828598985748, -0.0265646185119588)


@functools.cache
def _stable_phase(drifts: tuple[float, ...], kicks: tuple[float, ...]) -> float:
    """Where half the trace of a step first leaves [-1, 1]."""
    phase = np.arange(1e-3, 10.0, 1e-3)
    x, p = np.stack([np.ones_like(phase), np.zeros_like(phase)]), np.stack([np.zeros_like(phase), np.ones_like(phase)])
    x = x + drifts[0] * phase * p
    for drift, kick in zip(drifts[1:], kicks, strict=True):
        p = p - kick * phase * x
        x = x + drift * phase * p
    grows = np.abs(x[0] + p[1]) / 2 > 1 + 1e-9
    return float(phase[np.argmax(grows) - 1])


def _whole(first: tuple[float, ...], count: int) -> tuple[float, ...]:
    """A palindrome of `count` numbers that add up to 1; those in the middle are what is missing."""
    missing = 1 - 2 * sum(first)
    middle = (missing,) if count % 2 else (missing / 2, missing / 2)
    return (*first, *middle, *reversed(first))
