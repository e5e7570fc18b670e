"""What a run of the exact rod returns."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import tracing, validation
from ..motions.state import State
from .modes import Waves


class Errors(NamedTuple):
    """What half the modes change, at every time (T,): `angle` (rad), `rate` (rad/s), the tip's displacement `tip` (m).

    In space `angle` is that between the two directors, and `rate` the length of the difference of their rates.
    """

    angle: Float[Array, " T"]
    rate: Float[Array, " T"]
    tip: Float[Array, " T"]


class ContinuumSolution(eqx.Module):
    """A run of the exact rod.  Leading axes (T, ...) are times.

    `ts` (T,) in s; `energy` (T,) in J; `angular_momentum` (T,), in space (T, 3), in kg m^2/s; `loads` (T, 3), |d'|^2, g . d and
    the force at the tip along the rod; `error`, an `Errors` or None; `steps`, how many were taken; `ended`, whether the run
    reached its end; `lowest`, the least strain at a thousand times on the way.  `states` holds director, centre and their rates,
    and as amplitudes those of the exact rod's modes (T, modes), which `waves` are.
    """

    ts: Float[Array, " T"]
    states: State
    energy: Float[Array, " T"]
    angular_momentum: Float[Array, " T"] | Float[Array, "T 3"]
    loads: Float[Array, "T 3"]
    error: Errors | None
    steps: Array
    ended: Bool[Array, ""]
    lowest: Float[Array, ""]
    waves: Waves
    system: Any

    @property
    def ok(self) -> Bool[Array, ""]:
        """Whether the run reached its end, finite and nowhere pressed together to nothing (strain -1): at the times `ts`, and
        at a thousand between them (at fewer sections)."""
        return self.ended & (jnp.minimum(_lowest(self.waves, self.states.amplitudes), self.lowest) > -1)

    @property
    def angle(self) -> Float[Array, " T"]:
        """Angle above the horizontal in rad; in the plane counted over all turns."""
        return self.states.angle

    @property
    def rate(self) -> Float[Array, " T"]:
        """Rate of `angle` in rad/s."""
        return self.states.rate

    @property
    def azimuth(self) -> Float[Array, " T"]:
        """Angle about the vertical in rad, in space only; continuous if `ts` are less than half a turn apart."""
        return jnp.unwrap(self.states.azimuth)

    @property
    def azimuth_rate(self) -> Float[Array, " T"]:
        """Rate of `azimuth` in rad/s; in space only."""
        return self.states.azimuth_rate

    @property
    def director(self) -> Float[Array, "T D"]:
        """Unit vector along the rod."""
        return self.states.direction

    @property
    def center(self) -> Float[Array, "T D"] | None:
        """Centre of mass in m, in flight; else None."""
        return self.states.center

    @property
    def tip_stretch(self) -> Float[Array, " T"]:
        """Displacement u of the tip in m, away from the pivot (in flight from the centre of mass)."""
        return self.states.amplitudes @ self.waves.tip + self.loads @ self.waves.slack

    @property
    def tip(self) -> Float[Array, "T D"]:
        """Position of the tip in m: from the pivot, in flight from the origin."""
        tip = (self.waves.reach + self.tip_stretch)[:, None] * self.director
        return tip if self.center is None else tip + self.center

    @property
    def strain(self) -> Float[Array, " T"]:
        """Elongation over length."""
        elongation = self.states.amplitudes @ self.waves.elongation + self.loads @ self.waves.slack_elongation
        return elongation / self.system.rod.length

    def strain_field(self, s: Float[Array, " points"]) -> Float[Array, "T points"]:
        """Strain at the material coordinates s (m)."""
        rod = self.system.rod
        s = validation.along("s", s, rod.length)
        rigidity = rod.modulus(s) * rod.area(s)
        amplitudes = jnp.concatenate([self.states.amplitudes, self.loads], axis=1)
        return amplitudes @ self.waves.tension_at(s).T / rigidity[None, :]

    def __str__(self):
        if not tracing.known(self.ts):
            return f"ContinuumSolution at {self.ts.size} times"
        n = self.waves.omega.size
        lines = [
            f"{self.ts.size} times to t = {float(self.ts[-1]):.6g} s with {n} modes of the exact rod, {int(self.steps)} "
            f"steps: {'ok' if bool(self.ok) else 'not ok'}"
        ]
        if self.error is not None:
            worst = [float(np.max(np.asarray(x))) for x in self.error]
            lines.append(
                f"half the modes change angle, rate, tip by {worst[0]:.1e} rad, {worst[1]:.1e} rad/s, {worst[2]:.1e} m"
            )
        return "\n".join(lines)


@tracing.run_seldom
def _lowest(waves: Waves, amplitudes: Float[Array, "T modes"]) -> Float[Array, ""]:
    return jnp.min(jax.vmap(waves.strain)(amplitudes))
