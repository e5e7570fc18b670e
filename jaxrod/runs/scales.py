"""How fast a scene moves and how far it stretches: what steps, weights of errors and plans are measured by."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.equations import DiscreteSystem, eigenvalues
from ..motions.preview import INSTANTS, Preview
from ..motions.state import State


class Scales(eqx.Module):
    """Rates of a run in rad/s and its strain, as far as its start and its loads show; without derivatives.

    - `spin`: its rate at the start and what the impulses of its loads add, as far as they were looked at; or the fastest of a
      drive.
    - `swing`: what gravity adds.  From the highest place to the lowest 1/2 J w^2 grows by 2 |g| S, with J the moment of
      inertia and S the first moment at rest: w^2 = 4 |g| S / J, and half of that on average.  Small swings have half the
      rate.
    - `least`: 1 / (t1 - t0).  Nothing slower shows in a run.
    - `axial` (n,): the natural rates of the strain, ascending; there are none where the strain has no motion of its own.
    - `strain`: what the start brings, and what spin and swing pull: sum |a| + sum |a'| / axial + (spin^2 + swing^2) / axial^2,
      by the slowest of `axial`.
    """

    spin: Float[Array, ""]
    swing: Float[Array, ""]
    least: Float[Array, ""]
    axial: Float[Array, " n"]
    strain: Float[Array, ""]

    @staticmethod
    def of(scene: DiscreteSystem, start: State, t0, t1, looked: Preview | None = None) -> "Scales":
        """Those of a run from t0 to t1, with what its loads were seen to do."""
        spin = jnp.sqrt(start.direction_rate @ start.direction_rate)
        spin = spin if looked is None else spin + looked.gained
        if scene.motion.prescribed:
            spin = scene.motion.largest_rate(jnp.linspace(t0, t1, INSTANTS))
        swing = jnp.sqrt(scene.fastest_swing)
        axial = jnp.sqrt(eigenvalues(scene.body)) if scene.n and not scene.condensed else jnp.zeros((0,), spin.dtype)
        strain = jnp.zeros_like(spin)
        found = Scales(spin, swing, 1 / (t1 - t0), axial, strain)
        if axial.size:
            brought = jnp.sum(jnp.abs(start.amplitudes)) + jnp.sum(jnp.abs(start.amplitude_rates)) / axial[0]
            pulled = (spin**2 + swing**2) / axial[0] ** 2
            found = eqx.tree_at(lambda x: x.strain, found, brought + pulled)
        return jax.lax.stop_gradient(found)

    @property
    def turning(self) -> Float[Array, ""]:
        """The fastest that the rod may turn, in rad/s."""
        return jnp.sqrt(self.spin**2 + self.swing**2 + self.least**2)

    @property
    def mean(self) -> Float[Array, ""]:
        """How fast it turns on average, in rad/s, where it turns about; of no account how long it runs."""
        return jnp.sqrt(self.spin**2 + self.swing**2 / 2)

    @property
    def slow(self) -> Float[Array, ""]:
        """The rate of spin and small swings, by which velocities are measured, in rad/s."""
        return jnp.sqrt(self.spin**2 + self.swing**2 / 4 + self.least**2)
