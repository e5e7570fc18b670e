"""A way to run a scene: rung, solver, steps and float type, chosen for an accuracy."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import tracing
from ..core.precision import in_type
from ..mechanics.system import System
from ..motions.state import State
from ..runs.scales import Scales
from ..shapes.basis import AbstractBasis, QuasiStatic
from .ladder import brought


class Plan(eqx.Module):
    """How to run a scene so that a quantity comes out to a tolerance, as `jaxrod.plan` finds it.  It prints itself.

    `met`: whether there is such a way; `basis`, `solver`, `dtype`, and `step` in s or, of a solver that adapts its steps,
    `tolerance`: that way, or the nearest to it; `n_steps` for the planned time; `error`: the error that is to be expected, in
    the quantity's `unit`; `cost`: computing time in s of one scene of a sweep, on one core of the machine that
    `benchmarks/calibration.py` was last run on; `why`, a sentence.

    `simulate(system, start, plan=plan)` follows it, in other scenes too: these take as many steps to an axial period.
    """

    met: bool = eqx.field(static=True)
    basis: AbstractBasis
    solver: Any
    dtype: str = eqx.field(static=True)
    step: float | None = eqx.field(static=True)
    tolerance: float | None = eqx.field(static=True)
    rate: float = eqx.field(static=True)
    n_steps: int = eqx.field(static=True)
    static: bool = eqx.field(static=True)
    error: float = eqx.field(static=True)
    cost: float = eqx.field(static=True)
    asked: float = eqx.field(static=True)
    quantity: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    why: str = eqx.field(static=True)

    def __repr__(self):
        unit = f" {self.unit}" if self.unit else ""
        if not self.met:
            return f"{self.quantity} to {self.asked:.0e}{unit}: cannot be met, because {self.why}"
        steps = f"{self.n_steps} step{'s' * (self.n_steps != 1)}{' that adapt' * (self.step is None)}"
        steps = f"{steps} of {type(self.solver).__name__}"
        return (
            f"{self.quantity} to {self.asked:.0e}{unit}: {named(self.basis)}, {steps}, {self.dtype}; "
            f"error {self.error:.1e}{unit}, {1e6 * self.cost:.3g} us of one core a scene; {self.why}"
        )

    def applied(self, system: System, start: State, t0: Any = 0.0) -> tuple[System, State]:
        """The scene and its start, at t0 in s, on this plan's rung, in its float type.

        **Raises:** `ValueError` if the plan says that the tolerance cannot be met.
        """
        if not self.met:
            raise ValueError(f"plan={self}; plan with a larger tolerance.")
        return in_type(self.dtype, brought(system, start, self.basis, self.static, t0))

    def steps(self, system: System, start: State, t0: Any, t1: Any) -> dict[str, Any]:
        """The keywords of `simulate` for solver and steps of a run from t0 to t1, of a scene on this plan's rung."""
        if self.step is None:
            return {"tolerance": self.tolerance}
        slower = self.rate / step_rate(in_type("float64", system), in_type("float64", start), t0, t1)
        # Not one more because t1 is rounded: a step's own count was tried, its neighbour may be in resonance.
        steps = jnp.ceil(jax.lax.stop_gradient((t1 - t0) / (self.step * slower)) * (1 - 1e-6))
        return {"solver": self.solver, "n_steps": jnp.maximum(steps, 1)}


@tracing.run_seldom
def step_rate(system: System, start: State, t0: Any, t1: Any) -> Float[Array, ""]:
    """What steps are measured by, in rad/s: the lowest axial rate of the rung, else its turning, however long it runs."""
    scales = Scales.of(system.discrete, start, jnp.asarray(t0, float), jnp.asarray(t1, float))
    rate = scales.axial[0] if scales.axial.size else jnp.hypot(scales.spin, scales.swing)
    return jnp.where(rate > 0, rate, 1.0)


def named(basis: AbstractBasis) -> str:
    """A basis as one writes it."""
    if isinstance(basis, QuasiStatic):
        return f"QuasiStatic({named(basis.basis)})"
    return f"{type(basis).__name__}({basis.n})" if basis.n else "rigid"
