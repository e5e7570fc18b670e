"""What a run returns."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8

from .. import configuration
from ..continuum.neglected import ModelLimits, model_limits
from ..core import tracing, validation
from ..core.result import Result
from ..mechanics.chart import Director, Strains
from ..mechanics.lagrangian import Lagrangian
from ..mechanics.system import System
from ..motions.state import State
from ..rods.rod import Rod
from .invariants import Ledger, account

_RANGES = {"angle": "rad", "strain": "", "energy": "J"}  # that are printed, with their units
_SLOW_TURNING = 5  # bending frequency over turns a second above which a rod stays straight enough
_SMALL_ERROR = 0.01
_LARGE_STRAIN = 0.1
_MANY = 1e4  # states, for which a program is worth optimising


class Solution(eqx.Module):
    """A run: times, states and how it ended.  Leading axes (T, ...) are times; under `vmap` scenes come before them.

    `ts` (T,) in s; `states`, a `State` with leading axis T (for a `Lagrangian` a pair q, v; with `SaveAt(fn=)` what it
    returned); `result`, a code of `Result`; `stats`, counts of steps, the mean `step` in s and `t_end`, the time in s the
    run reached; `start`, where it began; `method`, solver and coordinates; `budget`, the error of a quantity, of several
    a tuple, if asked for; `event`, which of the conditions of `event=` ended it, -1 if none did (None: none were given).
    What the run did not reach is NaN.
    """

    ts: Float[Array, "*scenes T"]
    states: Any
    result: Int8[Array, "*scenes"]
    stats: dict[str, Array]
    system: System | Lagrangian
    start: Any
    method: str = eqx.field(static=True)
    budget: Any = None
    event: Int[Array, "*scenes"] | None = None

    @property
    def ok(self) -> Bool[Array, "*scenes"]:
        """Whether the run reached its end."""
        return self.result == Result.ok

    @property
    def angle(self) -> Float[Array, "*scenes T"]:
        """Angle above the horizontal in rad; in the plane counted over all turns."""
        return self._state.angle

    @property
    def rate(self) -> Float[Array, "*scenes T"]:
        """Rate of `angle` in rad/s."""
        return self._state.rate

    @property
    def azimuth(self) -> Float[Array, "*scenes T"]:
        """Angle about the vertical in rad, counted over all turns; in space only."""
        return self._state.azimuth

    @property
    def azimuth_rate(self) -> Float[Array, "*scenes T"]:
        """Rate of `azimuth` in rad/s; in space only."""
        return self._state.azimuth_rate

    @property
    def director(self) -> Float[Array, "*scenes T D"]:
        """Unit vector along the rod."""
        return self._state.direction

    @property
    def strain(self) -> Float[Array, "*scenes T"]:
        """Elongation over length."""
        return self._state.strain

    @property
    def strain_rate(self) -> Float[Array, "*scenes T"]:
        """Rate of `strain` in 1/s."""
        return self._state.strain_rate

    @property
    def center(self) -> Float[Array, "*scenes T D"] | None:
        """Centre of mass in m, in flight; else None."""
        return self._state.center

    @property
    def tip(self) -> Float[Array, "*scenes T D"]:
        """Position of the tip in m."""
        return self._each(_tip, self._state)

    @property
    def energy(self) -> Float[Array, "*scenes T"]:
        """T + V in J."""
        return self._each(_energy, self.states if isinstance(self.system, Lagrangian) else self._state)

    @property
    def angular_momentum(self) -> Float[Array, "*scenes T"] | Float[Array, "*scenes T 3"]:
        """Angular momentum about the pivot (in flight the centre of mass) in kg m^2/s."""
        return self._each(_angular_momentum, self._state)

    @property
    def ledger(self) -> Ledger:
        """Change of energy and angular momentum, largest strain, room to collapse, largest turning in a step.

        **Raises:** `ValueError` for a `Lagrangian`, and where `SaveAt(fn=)` saved something else than states.
        """
        if not isinstance(self.system, System) or not isinstance(self.states, State):
            raise ValueError(
                "a ledger needs a System and its states; of a Lagrangian ask for energy, and leave out fn=."
            )
        stats = _numbers(self.stats)
        return _account(self.ts.ndim - 1, self.system, self.start, self.states, stats, seldom=self._few)

    def shape(self, s: Float[Array, " points"]) -> Float[Array, "*scenes T points D"]:
        """Positions in m of the material points s (m)."""
        return self._each(jax.tree_util.Partial(_shape, self._along(s)), self._state)

    def strain_field(self, s: Float[Array, " points"]) -> Float[Array, "*scenes T points"]:
        """Strain at the material points s (m)."""
        return self._each(jax.tree_util.Partial(_strain_field, self._along(s)), self._state)

    @property
    def _state(self) -> State:
        if not isinstance(self.states, State):
            raise AttributeError(
                "this solution holds no states of a System; ask for sol.states, which is (q, v) of a Lagrangian, or what the "
                "fn= of saveat= returned."
            )
        return self.states

    def _along(self, s: Any) -> Float[Array, " points"]:
        assert isinstance(self._state, State) and isinstance(self.system, System)
        return validation.along("s", s, self.system.rod.length)

    def _each(self, quantity: Callable, states: Any) -> Array:
        return _each(quantity, self.ts.ndim - 1, self.system, self.ts, states, seldom=self._few)

    @property
    def _few(self) -> bool:
        return self.ts.size < _MANY

    def complaint(self) -> str:
        """One sentence on how a run ended that did not reach its end."""
        bad = ~np.atleast_1d(self.ok)
        t_end = np.atleast_1d(self.stats["t_end"])[bad][0]
        where = f"at t={t_end:.9g} s" if bad.size == 1 else f"in {bad.sum()} of {bad.size} scenes"
        longest = np.nanmin(self.stats.get("longest_step", np.inf))
        if longest < np.finfo(np.float32).max and np.any(np.atleast_1d(self.result == Result.coarse)):
            where += f"; the longest step that can be stable is {longest:.4g} s"
        system, stopped = self.system, bad.size == 1 and bool(np.all(self.result == Result.max_steps))
        if stopped and isinstance(system, System) and system.forces and _overdamped(system, self.start):
            chart = "" if system.motion.prescribed else ", chart=jaxrod.Director()"
            where += f"; damping is stiffer than any vibration: take solver=diffrax.Kvaerno5(){chart}"
        return f"{Result[self.result]} ({where}); catch SimulationError for what was computed, or pass throw=False."

    def __repr__(self):
        if not tracing.known(self.ts) or self.ts.ndim > 1:
            return f"Solution of {self.ts.shape[0]} scenes by {self.method}"
        lines = [
            f"{self.ts.size} times to t = {self.stats['t_end']:.6g} s by {self.method}, {self.stats['num_steps']} steps "
            f"in {self._type()}: {self._ended()}"
        ]
        if isinstance(self.states, State):
            ranges, limits, turning, largest = jax.tree.map(np.asarray, _looked_over(self.system, self.states))
            for (name, unit), (least, most) in zip(_RANGES.items(), ranges, strict=True):
                lines.append(f"{name:>8}: {least:.6g} .. {most:.6g} {unit}".rstrip())
            if limits is not None:
                lines += [f"left out: {line}" for line in self._left_out(limits, float(turning), float(largest))]
        if self.budget is not None:
            lines += map(str, self.budget if isinstance(self.budget, tuple) else [self.budget])
        return "\n".join(lines)

    def _ended(self) -> str:
        ran_on = self.event is None or self.event < 0
        return Result[self.result] if ran_on else f"condition {self.event} of event= ended it"

    def _type(self) -> str:
        forgotten = jnp.result_type(float) == jnp.float32 and not configuration.was_called()
        return f"{self.ts.dtype}{', as jaxrod.configure() was not called' * forgotten}"

    def _left_out(self, limits: ModelLimits, turning: float, largest: float) -> list[str]:
        """What the model does not have and this motion would have shown, with so many turns a second and this strain."""
        assert isinstance(self.system, System) and isinstance(self.system.rod, Rod)
        lines = []
        bending, axial = float(limits.bending_frequencies[0]), float(limits.axial_frequency)
        if bending < _SLOW_TURNING * turning:
            lines.append(f"bending, {bending:.3g} Hz (axial {axial:.3g} Hz), at up to {turning:.3g} turns a second")
        if limits.lateral_inertia > _SMALL_ERROR:
            lines.append(f"lateral inertia, {100 * float(limits.lateral_inertia):.2g} % of the axial frequency")
        if self.system.rod.linear and largest > _LARGE_STRAIN:
            lines.append(f"a law of large strain, which reaches {largest:.2g}; Rod(law=...) takes one")
        return lines


def _overdamped(system: System, start: State) -> bool:
    """Whether some motion at the start decays faster than any oscillates: explicit steps are as short as its decay."""
    by_q, by_v = _slopes(system, start)
    n = len(by_q)
    rates = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [by_q, by_v]]))
    return bool(np.max(-rates.real, initial=0.0) > np.max(np.abs(rates.imag), initial=0.0))


@tracing.run_seldom
def _slopes(system: System, start: State) -> tuple[Array, Array]:
    """Derivatives of the accelerations at the start, by coordinates and by velocities."""
    equations = system.equations(Strains() if system.motion.prescribed else Director())
    q, v = equations.encode(0.0, start)
    return jax.jacfwd(lambda q, v: equations.acceleration(0.0, q, v), argnums=(0, 1))(q, v)


@tracing.program
def _each(quantity: Callable, scenes: int, system, ts, states) -> Array:
    """A quantity of (system, t, state) at every time of every scene."""
    over = jax.vmap(quantity, in_axes=(None, 0, 0))
    for _ in range(scenes):
        over = jax.vmap(over)
    return over(system, ts, states)


@tracing.run_seldom
def _looked_over(system: Any, states: State) -> tuple[list, ModelLimits | None, Array, Array]:
    """What is printed of a run, by one program: ranges, limits of the model, turns a second, the largest strain."""
    scene = system.discrete
    energy = sum(jax.vmap(scene.all_energies)(states))
    values: dict[str, Any] = {"angle": states.angle, "strain": states.strain, "energy": energy}
    ranges = [(jnp.nanmin(values[name]), jnp.nanmax(values[name])) for name in _RANGES]
    turning = jnp.nanmax(jnp.sqrt(jnp.sum(states.direction_rate**2, axis=-1))) / (2 * np.pi)
    largest = jnp.nanmax(jnp.abs(scene.body.field(states.amplitudes)), initial=0.0) if scene.n else jnp.zeros(())
    limits = model_limits(system) if isinstance(system.rod, Rod) else None
    return ranges, limits, turning, largest


@tracing.program
def _account(scenes: int, system, start, states, stats) -> Ledger:
    of_one = account
    for _ in range(scenes):
        of_one = jax.vmap(of_one)
    return of_one(system, start, states, stats)


def _numbers(stats):
    return {name: stats[name] for name in ("step", "lowest_strain") if name in stats}


def _tip(system, t, state):
    return system.tip(state)


def _energy(system, t, state):
    return system.energy(t, *state) if isinstance(system, Lagrangian) else system.energy(state)


def _angular_momentum(system, t, state):
    return system.angular_momentum(state)


def _strain_field(s, system, t, state):
    return system.strain_field(state, s)


def _shape(s, system, t, state):
    return system.shape(state, s)
