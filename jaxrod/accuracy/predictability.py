"""How far ahead a motion can be told: where starts that nobody can tell apart part."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int8

from ..core import precision, progress, validation
from ..core.linear_algebra import singular_values
from ..core.result import Result
from ..core.units import Number
from ..mechanics import equilibria
from ..mechanics.chart import Local
from ..mechanics.system import System
from ..motions.state import State
from ..runs import arguments
from ..runs.execution import solve

_TIMES = 1000  # at which the distance is looked at; between them its logarithm is taken as straight


class Horizon(eqx.Module):
    """How far ahead a motion can be told; it prints itself.

    `time` in s from the start, inf if the run ends within tolerance, NaN if it failed before that (`result`); `growth_rate`
    in 1/s of the distance, which tends to the Lyapunov exponent for long runs: of regular motion, where distances grow in
    proportion to time, to zero; `ts` (T,) in s and `growth` (T,), the distance over that of the starts.
    """

    time: Float[Array, ""]
    growth_rate: Float[Array, ""]
    ts: Float[Array, " T"]
    growth: Float[Array, " T"]
    result: Int8[Array, "*scenes"]

    def __str__(self):
        searched = len(self.ts) * float(self.ts[1] - self.ts[0])
        told = (
            f"told to {float(self.time):.4g} s ahead"
            if jnp.isfinite(self.time)
            else f"told to the end, {searched:.4g} s"
        )
        told = "the run failed before that could be told" if jnp.isnan(self.time) else told
        times = f"{float(self.growth[-1]):.2g} times in {searched:.4g} s"
        return f"{told}; distances grow by {float(self.growth_rate):.3g} /s ({times}; regular motion: in proportion to time)"


def horizon(
    system: System, start: State, *, t1: Number, tolerance: Number, distance: Number = 1e-12, t0: Number = 0.0
) -> Horizon:
    """The time beyond which two starts `distance` apart differ by `tolerance`.

    No solver reaches further: rounding alone sets two starts apart.  The distance is followed by its linear equations (the
    derivative of the run by its start), in the direction that grows most, so rounding does not limit it; of a distance
    near one it is a guess.

    **Arguments:**

    - `t0`, `t1`: when the motion begins and the search ends, in s.
    - `tolerance`: of the tip's position over the length of the rod, in flight about the centre of mass.
    - `distance`: of the starts: in angles (rad) and strains, and in their rates over the natural rate of the scene (the
      axial one).

    **Raises:** `ValueError` for numbers that are not positive, t1 not after t0, a distance not below the tolerance, and where
    nothing can be set apart (a rigid driven rod).

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=17658.0, density=1200.0)  # swing to strain 1 : 2
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> start = system.state(angle=-1.5708, strain=0.3333, rate=2.7, strain_rate=-4.8)
    >>> print(jaxrod.horizon(system, start, t1=60.0, tolerance=1e-6).time.round(0))
    36.0
    """
    arguments.check_system_and_start(system, start)
    _, t0, t1, _ = arguments.times(None, t1, t0, None, precision.float_type(system, start), by_the_clock=True)
    tolerance = validation.positive("tolerance", tolerance, "", "lengths of the rod")
    distance = validation.positive("distance", distance, "", "rad and strain")
    if validation.fails(lambda distance, tolerance: distance < tolerance, distance, tolerance):
        raise ValueError(
            f"distance={validation.shown(distance)} of the starts must be below tolerance={validation.shown(tolerance)}; else "
            "nothing can be told from the first moment on."
        )
    if system.motion.prescribed and system.basis.n == 0:
        raise ValueError("motion=Driven() leaves a rigid rod nothing to set apart; take basis=Ritz(1) or more.")
    with progress.line("horizon"):
        return jax.block_until_ready(_horizon(system, start, t0, t1, tolerance, distance))


@eqx.filter_jit
def _horizon(system: System, start: State, t0, t1, tolerance, distance) -> Horizon:
    dtype = precision.float_type(system, start)
    ts, scene = jnp.linspace(t0, t1, _TIMES + 1, dtype=dtype)[1:], system.discrete
    natural = equilibria.natural_rate(scene)

    def tip(offset):
        # Adaptive: of equal steps, written out stage by stage, the forward derivative takes XLA minutes to compile.
        forward = {"solver": diffrax.Dopri8(), "adjoint": diffrax.ForwardMode()}
        run = solve(system, _moved(system, start, natural, offset), t0=t0, ts=ts, **forward)
        reach = jax.vmap(scene.body.reach)(run.states.amplitudes)
        return reach[:, None] * run.states.direction / system.rod.length, run.result

    free = system.motion.dimension - 1 if not system.motion.prescribed else 0
    still = jnp.zeros(2 * (free + system.basis.n), dtype)

    def slope(direction):
        _, along, result = jax.jvp(tip, (still,), (direction,), has_aux=True)
        return along, result

    # One direction after the other, each with steps of its own.
    slopes, result = jax.lax.map(slope, jnp.eye(still.size, dtype=dtype))
    growth, result = (
        jax.vmap(lambda along: singular_values(along, 1)[0], in_axes=1)(slopes),
        jax.tree.map(lambda x: x[0], result),
    )
    beyond = distance * growth >= tolerance
    first = jnp.argmax(beyond)
    # Straight in the logarithm from the time before, where there is one.
    earlier = jnp.maximum(first - 1, 0)
    low, high = jnp.log(growth[earlier]), jnp.log(growth[first])
    rise = jnp.where(high > low, high - low, 1.0)
    part = jnp.where(high > low, (jnp.log(tolerance / distance) - low) / rise, 1.0)
    passed = ts[earlier] + jnp.clip(part, 0.0, 1.0) * (ts[first] - ts[earlier])
    never = jnp.where(result == Result.ok, jnp.inf, jnp.nan)
    return Horizon(jnp.where(jnp.any(beyond), passed - t0, never), _slope(ts, growth), ts, growth, result)


def _moved(system: System, start: State, natural, offset) -> State:
    """The start with its angles, strains and their rates (over the natural rate) moved by `offset`."""
    n, d = system.basis.n, start.direction
    place, rate = jnp.split(offset, 2)
    rate = rate * natural
    across = Local(d, jnp.zeros_like(start.turns)).tangents()
    free = place.size - n
    if free:
        d = d + across @ place[:free]
        d = d / jnp.sqrt(d @ d)
    turning = start.direction_rate + (across @ rate[:free] if free else 0.0)
    turning = turning - (turning @ d) * d
    amplitudes, amplitude_rates = start.amplitudes + place[free:], start.amplitude_rates + rate[free:]
    return State(d, turning, amplitudes, amplitude_rates, start.turns, start.center, start.center_velocity)


def _slope(ts, growth) -> Float[Array, ""]:
    """Of the logarithm of the growth against time, by least squares."""
    seen = jnp.isfinite(growth) & (growth > 0)
    count = jnp.maximum(jnp.sum(seen), 1)
    heights = jnp.where(seen, jnp.log(jnp.where(seen, growth, 1.0)), 0.0)
    mean_t, mean = jnp.sum(jnp.where(seen, ts, 0.0)) / count, jnp.sum(heights) / count
    away = jnp.where(seen, ts - mean_t, 0.0)
    return jnp.sum(away * (heights - mean)) / jnp.maximum(jnp.sum(away**2), jnp.finfo(ts.dtype).tiny)
