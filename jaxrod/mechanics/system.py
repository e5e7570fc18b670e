"""One scene: a rod, how it is held, its strain basis, gravity and forces."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import precision, tracing, units, validation
from ..core.units import Number, Row
from ..integrators.splitting import AbstractSplitting
from ..motions.force import AbstractForce
from ..motions.motion import AbstractMotion
from ..motions.signal import signals
from ..motions.state import Placement, State, check_shapes
from ..rods.lumped import Lumped
from ..rods.rod import Rod
from ..shapes.basis import AbstractBasis, QuasiStatic, Ritz
from ..shapes.projection import Projection
from .chart import AbstractChart, Embedded, Strains
from .compatibility import check_parts
from .equations import Condensed, DiscreteSystem, Moving
from .initial_state import started
from .lagrangian import Lagrangian
from .splittings.driven_rotation import DrivenRotationSplitting
from .splittings.free_rotation import FreeRotationSplitting
from .splittings.uniform_strain import UniformStrainSplitting


class System(eqx.Module):
    """A scene.  It stores its inputs only, so `dataclasses.replace` gives a right new scene, under `jit` and `vmap` too.

    **Arguments:**

    - `rod`: a `Rod`, or a `Lumped` body.
    - `motion`: `Rotation()`, `Spherical()`, `Flight()` or `Driven(angle)`.
    - `basis`: `Ritz(n)` or `ForceRitz(n)`; `Ritz(0)` is rigid, `Ritz(1)`, the default, the paper's uniform strain;
      `LoadRitz(n)` needs the fewest shapes for frequencies; `QuasiStatic` of any has the strain follow without inertia.
    - `gravity`: g in m/s^2, downwards; or the acceleration as a vector (D,); or None.
    - `forces`: forces without a potential: `Torque`, `TipForce`, `PivotFriction`, `KelvinVoigt`, `ShakenBase` or your own.

    What is left out (`gravity=None`, `forces=()`, `Ritz(0)`) is not computed.

    >>> import jaxrod
    >>> cone = jaxrod.Cone(root_radius=0.02, tip_radius=0.03)
    >>> rod = jaxrod.Rod(length=1.0, section=cone, young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, motion=jaxrod.Rotation(), basis=jaxrod.Ritz(1), gravity=9.81)
    >>> print(f"{system.energy(system.state(angle=0.0, rate=15.0)):.4f} J")
    107.4425 J
    """

    rod: Rod | Lumped
    motion: AbstractMotion
    basis: AbstractBasis
    gravity: Float[Array, ""] | Float[Array, " D"] | None
    forces: tuple[AbstractForce, ...]

    def __init__(
        self,
        rod: Rod | Lumped,
        motion: AbstractMotion,
        basis: AbstractBasis | None = None,
        gravity: Number | Row | None = None,
        forces: Sequence[AbstractForce] = (),
    ):
        self.rod, self.motion = rod, motion
        self.basis = Ritz(1) if basis is None else basis
        self.gravity = None if gravity is None else _gravity(gravity, motion)
        if not isinstance(forces, tuple | list):
            raise ValueError(
                f"forces={validation.given(forces)} is not a sequence of forces; give a tuple such as (Torque(1.0),)."
            )
        self.forces = tuple(forces)
        check_parts(rod, motion, self.basis, self.forces, lambda: self.body)

    def __repr__(self):
        gravity = [] if self.gravity is None else [f"gravity={validation.brief(self.gravity, 'm/s^2')}"]
        forces = [f"forces={self.forces!r}"] if self.forces else []
        lines = [self.rod, f"{self.motion!r}, {self.basis!r}", *gravity, *forces, precision.float_type(self)]
        return "System(\n" + "".join(f"  {line},\n" for line in lines) + ")"

    # ---- the rod as the basis sees it

    @property
    def origin(self) -> Float[Array, ""]:
        """Material coordinate in m that stays put: the pivot, in flight the centre of mass."""
        if self.motion.flies:
            assert isinstance(self.rod, Rod)
            return self.rod.center_of_mass
        return jnp.zeros_like(self.rod.length) if self.motion.pivot is None else self.motion.pivot

    @property
    def body(self) -> Projection:
        """Mass matrix, stiffness matrix and first moments about `origin`."""
        return _projected(self.basis, self.rod, self.motion.pivot, self.motion.flies)

    @property
    def discrete(self) -> DiscreteSystem:
        """The scene as its basis sees it: what a run is made of."""
        return self._discretized(self.body)

    def _discretized(self, body: Projection) -> DiscreteSystem:
        condensed = isinstance(self.basis, QuasiStatic)
        return DiscreteSystem(
            self.motion, body, self.pull, self.forces, self.rod.length, condensed, self.basis.uniform
        )  # fmt: skip

    @property
    def pull(self) -> Float[Array, " D"] | None:
        """Gravity as a vector, in m/s^2; None where it is left out."""
        return None if self.gravity is None else self.motion.pull(self.gravity)

    def or_idle(self) -> tuple["System", DiscreteSystem, Bool[Array, ""]]:
        """The scene, itself and as its basis sees it, and whether it makes sense: what construction asks of known numbers.

        Where it makes none its numbers are some that anything runs with.
        """
        body = self.body
        inertia, limits = body.mass_matrix[0, 0], jnp.finfo(body.mass_matrix.dtype)
        sound = self.rod.valid() & _finite(self) & (inertia > limits.tiny / limits.eps) & _finite(body)
        if self.motion.pivot is not None:
            sound = sound & (self.motion.pivot >= 0) & (self.motion.pivot <= self.rod.length)
        idle = jax.tree.map(lambda x: jnp.where(sound, x, jnp.ones_like(x)), self)
        return idle, idle._discretized(body.or_idle(sound)), sound

    # ---- states

    def state(
        self,
        *,
        angle: Number = 0.0,
        rate: Number = 0.0,
        strain: Number = 0.0,
        strain_rate: Number = 0.0,
        amplitudes: Row | None = None,
        amplitude_rates: Row | None = None,
        azimuth: Number | None = None,
        azimuth_rate: Number | None = None,
        center: Row | None = None,
        center_velocity: Row | None = None,
    ) -> State:
        """A state of this scene.

        **Arguments:** `angle` above the horizontal (rad) and its `rate` (rad/s); `strain`, elongation over length
        (> -1), by the first shape alone, and `strain_rate` (1/s); or all `amplitudes` (n,) of the strain and their rates
        (1/s); for `Spherical`, `azimuth` (rad) and `azimuth_rate` (rad/s); for `Flight`, `center` (m) and
        `center_velocity` (m/s) of the centre of mass, two numbers each.  Where the motion is `Driven` angle and rate
        are those of t = 0 and not to be given.

        **Raises:** `ValueError` for non-finite numbers, a strain of -1 or less anywhere, strain of a rigid rod, and
        arguments that this motion does not have.
        """
        return started(
            self, angle, rate, strain, strain_rate, amplitudes, amplitude_rates, azimuth, azimuth_rate, center, center_velocity,
        )  # fmt: skip

    # ---- energies of a state, in J

    def kinetic_energy(self, state: State) -> Float[Array, ""]:
        """Kinetic energy T of one state."""
        return self._energies(state)[0]

    def elastic_energy(self, state: State) -> Float[Array, ""]:
        """Strain energy of one state."""
        return self._energies(state)[1]

    def gravity_energy(self, state: State) -> Float[Array, ""]:
        """Energy of weight of one state: zero at the pivot, in flight at the origin."""
        return self._energies(state)[2]

    def energy(self, state: State) -> Float[Array, ""]:
        """T + V of one state, V = 0 at the pivot (in flight at the origin)."""
        kinetic, elastic, weight = self._energies(state)
        return kinetic + elastic + weight

    def _energies(self, state: State) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        check_state(self, state)
        return self.discrete.all_energies(state)

    def power(self, t: Float[Array, ""], state: State) -> Float[Array, ""]:
        """Power in W of the forces, and of the drive where there is one: the rate at which `energy` grows."""
        check_state(self, state)
        rate = Placement(state.direction_rate, state.amplitude_rates, state.center_velocity)
        power = self.discrete.power(t, state, rate)
        return power + self.drive_torque(t, state) * state.rate if self.motion.prescribed else power

    def drive_torque(self, t: Float[Array, ""], state: State) -> Float[Array, ""]:
        """Moment in N m that a `Driven` rotation asks of its motor: growth of angular momentum less all other moments.

        **Raises:** `ValueError` for other motions.
        """
        check_state(self, state)
        (_, rate, acceleration), scene = self.motion.turning(t), self.discrete
        d, a = state.direction, state.amplitudes
        across = Placement(jnp.stack([-d[1], d[0]]), jnp.zeros_like(a), None)
        grown, growth = jax.jvp(scene.body.inertia, (a,), (state.amplitude_rates,))
        moment = grown * acceleration + growth * rate - scene.power(t, state, across)
        if self.gravity is None:
            return moment
        return moment + scene.weight(Placement(across.direction, a, None))  # linear in the director

    # ---- other quantities of a state

    def angular_momentum(self, state: State) -> Float[Array, ""] | Float[Array, " 3"]:
        """Angular momentum about the pivot (in flight the centre of mass) in kg m^2/s: in space a vector."""
        check_state(self, state)
        return self.discrete.angular_momentum(state)

    def shape(self, state: State, s: Float[Array, " points"]) -> Float[Array, "points D"]:
        """Positions in m of the material points s (m): from the pivot, in flight from the origin."""
        check_state(self, state)
        s = validation.along("s", s, self.rod.length)
        phi = self.basis.shapes(self.rod, s, self.motion.pivot, self.motion.flies)
        along = phi[0] + state.amplitudes @ phi[1:]
        points = along[:, None] * state.direction[None, :]
        return points if state.center is None else points + state.center[None, :]

    def tip(self, state: State) -> Float[Array, " D"]:
        """Position of the tip in m."""
        check_state(self, state)
        return self.discrete.tip(state)

    def strain_field(self, state: State, s: Float[Array, " points"]) -> Float[Array, " points"]:
        """Strain at the material points s (m)."""
        check_state(self, state)
        s = validation.along("s", s, self.rod.length)
        if isinstance(self.rod, Lumped):
            return jnp.broadcast_to(state.strain, s.shape)
        return state.amplitudes @ self.basis.strains(self.rod, s, self.motion.pivot, self.motion.flies)

    # ---- time

    @property
    def knots(self) -> Float[Array, " K"] | None:
        """Times in s at which a step is to end: those of every `Record` and `Impulse` in it; None if there are none."""
        found = signals((self.motion, self.forces))
        return jnp.concatenate([signal.knots for signal in found]) if found else None

    def unknown(self, t0: Float[Array, ""], t1: Float[Array, ""]) -> Any:
        """Whether a run from t0 to t1 (s) leaves a `Record`."""
        unknown = self.motion.unknown(t0, t1)
        for force in self.forces:
            unknown = unknown | force.unknown(t0, t1)
        return unknown

    def delayed(self, t0: Float[Array, ""]) -> "System":
        """The same scene on a clock that shows zero at t0 (s)."""
        forces = tuple(force.delayed(t0) for force in self.forces)
        return eqx.tree_at(lambda s: (s.motion, s.forces), self, (self.motion.delayed(t0), forces))

    # ---- equations of motion

    def check_chart(self, chart: AbstractChart) -> None:
        """Refuse, by `ValueError`, coordinates that this scene does not have."""
        if not isinstance(chart, AbstractChart):
            raise ValueError(
                f"chart={validation.given(chart)} is not a chart; give one, such as Angles() or Director()."
            )
        if isinstance(chart, Strains) != self.motion.prescribed:
            raise ValueError(
                f"chart={validation.given(chart)} does not fit motion={type(self.motion).__name__}(); leave chart= out, or take "
                "Strains() for Driven() and another for the rest."
            )
        if isinstance(chart, Embedded) and not self.flat:
            raise ValueError(
                "chart=Embedded() needs one uniform strain and no tip_inertia; take basis=Ritz(1) or chart=Director()."
            )

    @property
    def flat(self) -> bool:
        """Whether the kinetic energy is flat in q = (1 + eps) d: one uniform strain, and no inertia but the strained."""
        tip_inertia = getattr(self.rod, "tip_inertia", None)
        return self.basis.uniform and not isinstance(self.basis, QuasiStatic) and tip_inertia is None

    def equations(self, chart: AbstractChart, scene: DiscreteSystem | None = None) -> Moving | Condensed:
        """The equations of motion in the coordinates of `chart`; `scene`: this one as its basis sees it, if it is at hand.

        **Raises:** `ValueError` for coordinates that this scene does not have.
        """
        self.check_chart(chart)
        return (self.discrete if scene is None else scene).equations(chart)

    def split(
        self, start: State, t0: Any = 0.0, small_kicks: bool = False, scene: DiscreteSystem | None = None
    ) -> AbstractSplitting:
        """The flows that symplectic solvers compose, for a run from `start`; `scene` as of `equations`.

        `UniformStrainSplitting` where the strain is uniform, `DrivenRotationSplitting` where the rotation is driven, else, or
        for `small_kicks`, `FreeRotationSplitting`.

        **Raises:** `ValueError` where `unsplit` is not empty.
        """
        scene = self.discrete if scene is None else scene
        if why := self._why_not_split(lambda: scene):
            raise ValueError(f"a symplectic solver cannot step this scene: {why}; take solver=diffrax.Dopri8().")
        if self.motion.prescribed:
            return DrivenRotationSplitting(scene, t0, start)
        return (UniformStrainSplitting if self.splits_flat and not small_kicks else FreeRotationSplitting)(
            scene, t0, start
        )

    @property
    def splits_flat(self) -> bool:
        """Whether `split` is `UniformStrainSplitting`: the strain is uniform, and 1 + eps would not cost float32 its digits."""
        hooke = isinstance(self.rod, Lumped) or self.rod.linear
        return self.flat and not (hooke and precision.float_type(self) == jnp.float32)

    @property
    def unsplit(self) -> str:
        """Why this scene has no split; empty if it has one."""
        return self._why_not_split(lambda: self.discrete)

    def _why_not_split(self, scene: Callable[[], DiscreteSystem]) -> str:
        if isinstance(self.basis, QuasiStatic):
            return "the strain of QuasiStatic is no motion of its own"
        if self.forces and scene().rate_dependent:
            return "its forces depend on rates, or on full turns"
        if self.forces and self.motion.flies:
            return "its forces act on a rod in flight"
        if isinstance(self.rod, Rod) and not self.rod.linear and not self.flat:
            return "its strain law is not linear"
        if self.motion.prescribed and not self.basis.n:
            return "nothing moves in it but what is driven"
        return ""

    def lagrangian(self, chart: AbstractChart) -> Lagrangian:
        """The Lagrangian of this scene in the coordinates of `chart`, with its generalized forces.

        **Raises:** `ValueError` for `QuasiStatic`, whose equations are not those of one Lagrangian.
        """
        equations = self.equations(chart)
        if isinstance(equations, Condensed):
            raise ValueError(f"basis={self.basis!r} has no Lagrangian of its own; ask for equations(chart).")
        return equations.lagrangian


def check_system(system: Any) -> None:
    """Refuse, by `ValueError`, what is not a `System`."""
    if not isinstance(system, System):
        raise ValueError(f"system={validation.given(system)} is no scene; give a System(rod, motion, basis).")


def check_state(system: System, state: Any, name: str = "state") -> None:
    """Refuse, by `ValueError`, what is not one state of this scene."""
    check_shapes(system.motion, system.basis.n, state, name)


@tracing.run_seldom  # asked for in many places of a program, it is traced once for all of them
def _projected(basis: AbstractBasis, rod: Rod | Lumped, pivot, free: bool) -> Projection:
    # In the widest type there is: the shapes of a strong taper nearly cancel, and float32 has no digits to spare.
    wide_rod, wide_pivot = precision.in_type(jnp.result_type(float), (rod, pivot))
    return precision.in_type(precision.float_type(rod, pivot), basis.project(wide_rod, wide_pivot, free))


def _gravity(gravity, motion) -> Float[Array, ""] | Float[Array, " D"]:
    gravity = units.in_unit("gravity", gravity, "m/s^2")
    if np.ndim(gravity) == 0:
        return validation.not_negative("gravity", gravity, "m/s^2", "m/s^2 (or a vector, or None)")
    return validation.number("gravity", gravity, (getattr(motion, "dimension", np.size(gravity)),), "m/s^2")


def _finite(tree) -> Any:
    leaves = jax.tree.leaves(eqx.filter(tree, eqx.is_inexact_array))
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in leaves]))
