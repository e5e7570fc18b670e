"""Where a rod is and how it moves, free of coordinates and solvers."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import tracing, validation
from .motion import AbstractMotion


class Placement(NamedTuple):
    """Where the rod is: director (D,), strain amplitudes (n,), and in flight the centre of mass (D,) in m.

    Also used for its rate of change, and for a virtual one.
    """

    direction: Float[Array, " D"]
    amplitudes: Float[Array, " n"]
    center: Float[Array, " D"] | None


class State(eqx.Module):
    """Position and velocity of a rod, free of coordinates and solvers.  Leading axes, if any, are times or scenes.

    `direction` (..., D) and its rate (1/s); `amplitudes` (..., n) of the strain and their rates (1/s); `turns` (...),
    full turns made by the angle (in space: by the azimuth); in flight `center` and `center_velocity` (..., D) of the
    centre of mass in m and m/s.
    """

    direction: Float[Array, "*batch D"]
    direction_rate: Float[Array, "*batch D"]
    amplitudes: Float[Array, "*batch n"]
    amplitude_rates: Float[Array, "*batch n"]
    turns: Float[Array, "*batch"]
    center: Float[Array, "*batch D"] | None = None
    center_velocity: Float[Array, "*batch D"] | None = None

    def __getitem__(self, index) -> "State":
        """The states at this index of the leading axes."""
        return jax.tree.map(lambda x: x[index], self)

    def __repr__(self):
        numbers = jax.tree.leaves(self)
        if not all(isinstance(x, jax.Array | np.ndarray) and tracing.known(x) for x in numbers):
            return "State(...)"
        told = {"angle": "rad", "rate": "rad/s", "strain": "", "strain_rate": "1/s"}
        told |= {} if self.planar else {"azimuth": "rad", "azimuth_rate": "rad/s"}
        if self.turns.ndim == 0:
            return validation.written(self, self.direction.dtype, **told)
        ranges = [_range(name, getattr(self, name), unit) for name, unit in told.items()]
        return f"State of shape {self.turns.shape} in {self.direction.dtype}: {', '.join(ranges)}"

    @property
    def planar(self) -> bool:
        """Whether the director lives in a plane."""
        return self.direction.shape[-1] == 2

    @property
    @tracing.at_once
    def angle(self) -> Float[Array, "*batch"]:
        """Angle above the horizontal in rad: counted over all turns in the plane, in [-pi/2, pi/2] in space."""
        if self.planar:
            return heading(self.direction) + 2 * jnp.pi * self.turns
        return jnp.arctan2(self.direction[..., 2], _horizontal(self.direction)[1])

    @property
    @tracing.at_once
    def rate(self) -> Float[Array, "*batch"]:
        """Rate of `angle` in rad/s."""
        d, rate = self.direction, self.direction_rate
        if self.planar:
            return d[..., 0] * rate[..., 1] - d[..., 1] * rate[..., 0]
        outward, cos = _horizontal(d)
        return cos * rate[..., 2] - d[..., 2] * jnp.sum(outward * rate[..., :2], axis=-1)

    @property
    @tracing.at_once
    def azimuth(self) -> Float[Array, "*batch"]:
        """Angle about the vertical in rad, counted over all turns; undefined at the pole.  In space only."""
        self._in_space("azimuth")
        return heading(self.direction) + 2 * jnp.pi * self.turns

    @property
    @tracing.at_once
    def azimuth_rate(self) -> Float[Array, "*batch"]:
        """Rate of `azimuth` in rad/s; zero at the pole, where it is undefined.  In space only."""
        self._in_space("azimuth_rate")
        d, rate = self.direction, self.direction_rate
        square = d[..., 0] ** 2 + d[..., 1] ** 2
        polar = square == 0
        return jnp.where(
            polar, 0.0, (d[..., 0] * rate[..., 1] - d[..., 1] * rate[..., 0]) / jnp.where(polar, 1.0, square)
        )

    @property
    def strain(self) -> Float[Array, "*batch"]:
        """Elongation over length, the first amplitude (zero for a rigid rod)."""
        return self.amplitudes[..., 0] if self.amplitudes.shape[-1] else jnp.zeros_like(self.turns)

    @property
    def strain_rate(self) -> Float[Array, "*batch"]:
        """Rate of `strain` in 1/s."""
        return self.amplitude_rates[..., 0] if self.amplitude_rates.shape[-1] else jnp.zeros_like(self.turns)

    def _in_space(self, name: str) -> None:
        if self.planar:
            raise AttributeError(f"{name} belongs to Spherical motion; in the plane ask for angle and rate.")


def heading(direction: Float[Array, "*batch D"]) -> Float[Array, "*batch"]:
    """Angle in (-pi, pi] of the first two components; zero (with zero gradient) where both vanish."""
    polar = (direction[..., 0] == 0) & (direction[..., 1] == 0)
    return jnp.arctan2(direction[..., 1], jnp.where(polar, 1.0, direction[..., 0]))


def _range(name: str, values: Array, unit: str) -> str:
    return f"{name} {np.nanmin(values):.6g} .. {np.nanmax(values):.6g} {unit}".rstrip()


def _horizontal(direction: Float[Array, "*batch 3"]) -> tuple[Float[Array, "*batch 2"], Float[Array, "*batch"]]:
    """Unit vector and length of the horizontal part; at the pole, where it has none, the x axis and zero.

    The inner `where` keeps the gradient of the square root finite at the pole.
    """
    flat = direction[..., :2]
    square = jnp.sum(flat**2, axis=-1)
    polar = square == 0
    length = jnp.where(polar, 0.0, jnp.sqrt(jnp.where(polar, 1.0, square)))
    x_axis = jnp.zeros_like(flat).at[..., 0].set(1.0)
    unit = jnp.where(polar[..., None], x_axis, flat / jnp.where(polar, 1.0, length)[..., None])
    return unit, length


def check_start(motion: AbstractMotion, n: int, start: State) -> None:
    """**Raises:** `ValueError` for a start that `check_shapes` refuses, and for a director that is known not to be one."""
    check_shapes(motion, n, start, "start")
    d, rate = start.direction, start.direction_rate
    close = 1e-6 if d.dtype == np.float64 else 1e-3
    if validation.fails(lambda d: ~(np.abs(np.sum(d**2) - 1) > close), d):  # what is not finite is told by the run
        raise ValueError(
            f"start has direction={validation.shown(d)}, which is not of unit length; make it by system.state(angle=...)."
        )
    if validation.fails(lambda d, rate: ~(np.abs(d @ rate) > close * (1 + np.abs(rate).sum())), d, rate):
        raise ValueError(
            f"start has direction_rate={validation.shown(rate)}, which is not across direction={validation.shown(d)}; make it by "
            "system.state(angle=..., rate=...)."
        )


def check_shapes(motion: AbstractMotion, n: int, start: Any, name: str) -> None:
    """**Raises:** `ValueError` for a state with other shapes than a scene with this motion and n strain shapes has."""
    if not isinstance(start, State) or not all(x is None or hasattr(x, "shape") for x in vars(start).values()):
        raise ValueError(
            f"{name}={validation.given(start)} is not a state; make it by system.state(angle=..., rate=...)."
        )
    dimension, flight = motion.dimension, motion.flies
    if start.direction.shape != (dimension,) or start.amplitudes.shape != (n,) or (start.center is None) == flight:
        raise ValueError(
            f"{name} has director of shape {start.direction.shape} and strains of shape {start.amplitudes.shape}, but this "
            f"scene needs ({dimension},) and ({n},){' and a center' if flight else ''}; make it by system.state(...), and "
            "map over many with jax.vmap."
        )
