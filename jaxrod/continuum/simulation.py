"""The exact rod in time.

`simulate` is Galerkin's method in the exact rod's own modes, whose frequencies come from its integral equation, and
shares no code with the strain bases: it reads the rod, how it is held, what is prescribed, gravity, the force at the tip,
and the strain of the start.
"""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import calling, precision, progress, tracing, units, validation
from ..core.result import Result
from ..core.units import Number, Row
from ..integrators.reversal import forward_refused, reversible
from ..motions.force import TipForce
from ..motions.preview import Preview
from ..motions.state import State, check_start
from ..motions.stops import Stops, known_knots
from .compliance import order_for, support
from .dynamics import Dynamics
from .modes import Waves, waves
from .solution import ContinuumSolution, Errors

_LEAST = 1e-14  # tolerance that double precision still follows
_STEPS = 10_000_000
_STABLE = 3.0  # step times the highest frequency, of Dopri8
_FORWARD = (
    "a run of the exact rod has no forward derivative by default; give continuum.simulate adjoint=diffrax.ForwardMode(), "
    "and of second derivatives take both forward: jax.jacfwd(jax.jacfwd(f))"
)
_BACKWARD = (
    "adjoint=diffrax.ForwardMode() has no reverse derivative; take jax.jacfwd or jax.jvp, or leave adjoint= out."
)
_ONCE = (
    "a run of the exact rod has no reverse derivative of a reverse derivative; give continuum.simulate "
    "adjoint=diffrax.ForwardMode() and take jax.jacfwd(jax.jacfwd(f))."
)
_WATCHED, _WATCHES = 32, 1000  # sections, and times between those that are saved, at which strains are looked at


def simulate(
    system: Any, start: State, *, ts: Row, t0: Number = 0.0, static: bool = False, modes: int = 64,
    tolerance: Number = 1e-12, error: bool = True, adjoint: diffrax.AbstractAdjoint | None = None,
) -> ContinuumSolution:  # fmt: skip
    """Motion of the exact rod from `start` at time `t0`: director and longitudinal waves u(s, t), fully coupled.

    rho A (y_tt - |d'|^2 y - g . d) = (E A u_s)_s with y = x + u, the distance from the pivot (in flight the centre of mass)
    along the director d, free at the ends but for the body and the force at the tip; and the change of angular momentum
    |d'| int rho A y^2 ds by their moments.  Any section, breaks, pivot and strain law; `Rotation`, `Spherical`, `Flight`
    and `Driven`; of the forces, `TipForce`.

    **Arguments:**

    - `system`: a `System` of a `Rod`.  Of its basis the strain of the start is read, by `system.strain_field`, and nothing else.
    - `start`: a state, made by `system.state(...)`.
    - `ts`: increasing times in s (T,).
    - `static`: start from the strain that the rod has at rest in the spin, the gravity and the tip force of the start,
      instead of the strain of `start`.  Hooke's law.
    - `modes`: how many modes of the exact rod carry the displacement.  The step in time goes as their highest period.
    - `tolerance`: error of a step in natural units (radians, strains).
    - `error`: run half the modes too, at ten times the tolerance, and give the differences as `solution.error`.
    - `adjoint`: as in `diffrax.diffeqsolve`.  Left out, derivatives are those of reverse mode (`grad`, `jacrev`); forward-mode
      ones (`jvp`, `jacfwd`) need `diffrax.ForwardMode()`, and so does `jacfwd(jacfwd(...))` for second derivatives.

    **Convergence.**  Angle and rate gain three powers of `modes` or more, and so does the tip where the start is sudden (a
    kink in u_ss), five where it is `static`.  But where the strain itself jumps (release from stretch, a step load at the
    tip) the tip gains one alone: its error halves as the modes double, 0.2 / modes of the jump, and no number of them gives
    many digits.  So do all quantities under a tip force that reads `state.strain`, which is there that of the modes.
    Another strain law than Hooke's steepens waves; once they break there is no motion to converge to.  Nor is there where a
    section is pressed to nothing (strain -1): the run is not `ok` then.

    **Returns:** a `ContinuumSolution`.

    **Raises:** `ValueError` for a `Lumped` body, float32, forces other than `TipForce`, a start that is not of this
    system, `static` at or beyond the critical rate, numbers that make no sense, and derivatives that `adjoint` does not have.

    >>> import jax.numpy as jnp, jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    >>> sol = jaxrod.continuum.simulate(system, system.state(rate=15.0), ts=jnp.array([0.05, 0.1]), modes=16)
    >>> print(sol.angle.round(7), sol.tip_stretch.round(6), bool(sol.error.angle.max() < 1e-7))
    [0.7135833 1.4042295] [-0.00118  -0.001781] True
    """
    return by_first_modes(
        modes,
        system,
        start,
        ts=ts,
        t0=t0,
        static=static,
        modes=modes,
        tolerance=tolerance,
        error=error,
        adjoint=adjoint,
    )


def by_first_modes(
    kept: int, system: Any, start: State, *, ts: Row, t0: Number = 0.0, static: bool = False, modes: int = 64,
    tolerance: Number = 1e-12, error: bool = True, adjoint: diffrax.AbstractAdjoint | None = None,
) -> ContinuumSolution:  # fmt: skip
    """`simulate` with the first `kept` modes in arrays of `modes`, so that one program serves runs of fewer and of more.

    With `error` it is `simulate`.
    """
    rod, pivot, _ = support(system)
    _check(system, start, modes, static, error, adjoint)
    modes, dtype = int(modes), precision.float_type(system, start)
    if dtype != jnp.float64:
        raise ValueError(
            f"system and start are {dtype}; the exact rod needs float64: {precision.remedy(system, start)}."
        )
    tolerance = validation.positive("tolerance", tolerance, "", "radians and strains")
    if validation.fails(lambda x: x >= _LEAST, tolerance):
        raise ValueError(f"tolerance={validation.shown(tolerance)} is beyond float64; take {_LEAST:g} or more.")
    t0 = jnp.asarray(validation.number("t0", t0, unit="s"), dtype)
    saved = jnp.asarray(validation.numbers("ts", ts, "times in s", "s"), dtype)
    if validation.fails(lambda ts, t0: (np.diff(ts) > 0).all() and ts[0] >= t0 and ts[-1] > t0, saved, t0):
        raise ValueError(
            f"ts={validation.shown(saved)} must increase from t0={validation.shown(t0)} on; sort it and drop doubles."
        )
    backwards = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
    system, start = precision.in_type(dtype, (system, start))
    order = order_for(rod, pivot, modes)
    forwards = isinstance(adjoint, diffrax.ForwardMode)
    if not forwards:
        system, start, t0, saved = reversible((system, start, t0, saved), 1, _ONCE)
    knots, unknown = known_knots(system, None, t0, saved[-1])
    with forward_refused(_FORWARD), progress.line("continuum.simulate"):
        solution, beyond, unseen = _run(
            system, start, t0, saved, static, modes, jnp.asarray(kept), tolerance, error, order, backwards, knots
        )
    if validation.fails(lambda unseen: ~unseen, unseen):
        warnings.warn(Result.unseen.sentence, stacklevel=3)
    lost = (False if tracing.known(unseen) else unseen) | (False if unknown is None else unknown)
    solution = dataclasses.replace(solution, ended=solution.ended & jnp.logical_not(lost))
    solution = reversible(solution, 0, _BACKWARD) if forwards else solution
    if static and validation.fails(lambda x: x < 0, beyond):
        critical = f"{float(solution.waves.omega[0]):.6g} rad/s, where no strain holds the rod"
        raise ValueError(
            f"static=True: the start turns at or beyond the critical rate of {critical}; start it slower, or leave out static=."
        )
    return solution


def converged(
    system: Any,
    start: State,
    *,
    ts: Float[Array, " T"],
    change: float,
    quantity: Callable[[ContinuumSolution], Array] | None = None,
    modes: int = 16,
    most: int = 512,
    **others: Any,
) -> ContinuumSolution:
    """`simulate` with twice the modes again and again, until that changes `quantity` by no more than `change`.

    **Arguments:** `change`, in the unit of `quantity`, a function of the solution (left out: the displacement of the tip
    in m); `modes` to begin with and the `most` to try; the `others` as in `simulate`.  Not under a transformation.

    **Returns:** the last solution, with `error`.  **Warns**, saying what was reached, if `most` modes are not enough.

    >>> import jax.numpy as jnp, jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    >>> start, ts = system.state(rate=15.0), jnp.array([0.05, 0.1])
    >>> sol = jaxrod.continuum.converged(system, start, ts=ts, change=1e-6, modes=4)
    >>> print(sol.waves.omega.size, bool(sol.error.tip.max() <= 1e-6))
    8 True
    """
    change = units.in_unit("change", change, None)
    if validation.fails(lambda x: x > 0, validation.number("change", change)):
        raise ValueError(f"change={validation.brief(change)} must be positive; give it in the unit of quantity.")
    modes, most = validation.count("modes", modes, 2, "modes"), validation.count("most", most, 2, "modes")
    if quantity is not None and not callable(quantity):
        raise ValueError(f"quantity={validation.given(quantity)} is not a function; give one of a ContinuumSolution.")
    if most < 2 * modes:
        raise ValueError(f"most={most} leaves nothing to compare modes={modes} with; give twice as many or more.")
    asked = (lambda solution: solution.tip_stretch) if quantity is None else quantity
    quantity = jax.tree_util.Partial(calling.answer, "quantity", "of a ContinuumSolution -> one array", asked)
    reached, solution = np.inf, simulate(system, start, ts=ts, modes=modes, **others)
    while reached > change and 2 * modes <= most:
        modes, before = 2 * modes, np.asarray(quantity(solution))
        solution = simulate(system, start, ts=ts, modes=modes, **others)
        reached = float(np.max(np.abs(np.asarray(quantity(solution)) - before)))
    if reached <= change:
        return solution
    warnings.warn(
        f"{modes} modes still change the quantity by {reached:.2g}, more than change={change:.2g}; raise most={most}, or "
        "settle for it: where the strain jumps the error only halves as the modes double.",
        stacklevel=2,
    )
    return solution


def _check(system: Any, start: State, modes: int, static: bool, error: bool, adjoint: Any) -> None:
    validation.switch("static", static)
    validation.switch("error", error)
    validation.count("modes", modes, 2, "modes")
    why = untaken(system, static)
    if why:
        raise ValueError(why)
    check_start(system.motion, system.basis.n, start)
    if adjoint is not None and not isinstance(adjoint, diffrax.AbstractAdjoint):
        raise ValueError(f"adjoint={adjoint!r} is no adjoint; give an instance, such as diffrax.ForwardMode().")


def untaken(system: Any, static: bool) -> str:
    """Why the exact rod does not take this scene of a `Rod`; empty if it does."""
    for force in system.forces:
        if not isinstance(force, TipForce):
            return (
                f"forces holds {type(force).__name__}(), which the exact rod does not take; leave it out, or give its effect as "
                "TipForce(...) or Driven(...)."
            )
    if len(system.forces) > 1:
        return f"forces holds {len(system.forces)} of TipForce; give one that is their sum."
    if static and not system.rod.linear:
        return f"static=True is of Hooke's law; give start its strain, or leave out law={system.rod.law_name}."
    return ""


class _Run(NamedTuple):
    """What is kept of a run; `tip`, the tip's displacement in m."""

    states: State
    tip: Float[Array, " T"]
    energy: Float[Array, " T"]
    angular_momentum: Array
    loads: Float[Array, "T 3"]
    steps: Array
    ended: Array
    lowest: Array


@eqx.filter_jit
def _run(
    system, start, t0, ts, static, modes, kept, tolerance, error, order, adjoint, knots
) -> tuple[ContinuumSolution, Array, Array]:  # fmt: skip
    rod, pivot, free = support(system)
    all_waves = waves(rod, pivot, free, modes, order)
    looked = Preview.of(system.discrete, start, t0, ts[-1], knots)
    stops = Stops.of(t0, ts, knots, looked).distinct(t0)
    if error:  # one after the other by one program: half the modes are all of them, of which half carry nothing
        both = jnp.array([modes, modes // 2]), jnp.stack([tolerance, 10 * tolerance])
        runs = jax.lax.map(lambda x: _solve(system, all_waves, start, t0, ts, static, x[0], x[1], adjoint, stops), both)
        run, coarse = (jax.tree.map(lambda x: x[i], runs) for i in (0, 1))  # noqa: B023
        errors = _difference(run, coarse)
    else:
        run, errors = _solve(system, all_waves, start, t0, ts, static, kept, tolerance, adjoint, stops), None
        all_waves = all_waves.first(kept)
    solution = ContinuumSolution(
        ts,
        run.states,
        run.energy,
        run.angular_momentum,
        run.loads,
        errors,
        run.steps,
        run.ended,
        run.lowest,
        all_waves,
        system,
    )
    turning = start.direction_rate @ start.direction_rate
    if system.motion.prescribed:
        turning = system.motion.turning(t0)[1] ** 2
    return solution, turning - all_waves.omega[0] ** 2, jnp.asarray(False) if looked is None else looked.unseen


def _solve(system, all_waves: Waves, start: State, t0, ts, static, kept, tolerance, adjoint, stops) -> _Run:
    """The run with the first `kept` of these waves; a step ends at each of `stops`."""
    waves = all_waves.first(kept)
    force = system.forces[0].force if system.forces else None
    law = None if system.rod.linear else system.rod.law
    dynamics = Dynamics(waves, system.motion, system.pull, force, law, system.basis.n)

    q = dq = jnp.zeros_like(waves.omega)
    if static:
        q = dynamics.static(t0, start)
    elif system.basis.n:
        field = jax.vmap(lambda a: system.strain_field(eqx.tree_at(lambda x: x.amplitudes, start, a), waves.panels.s))
        q, dq = jax.vmap(waves.amplitudes)(field(jnp.stack([start.amplitudes, start.amplitude_rates])))

    pace = dynamics.pace
    times = (ts - t0) * pace
    # What is saved is the end of a step, as an interpolation would cost digits.  Steps beyond 3 / omega of the highest mode
    # are unstable: kept below, none is refused for that.
    controller = diffrax.PIDController(rtol=0.0, atol=tolerance, dtmax=_STABLE * pace / waves.omega[kept - 1])
    watched = jnp.linspace(0, waves.panels.s.size - 1, _WATCHED).astype(int)
    between = jnp.linspace(0, times[-1], _WATCHES)

    def lowest(t, y, args):
        return jnp.min(waves.strain(dynamics.size * y.a, watched))

    raw = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: dynamics(t0 + t / pace, y, args)),
        diffrax.Dopri8(),
        jnp.zeros_like(t0),
        times[-1],
        None,
        dynamics.encode(t0, start, q, dq),
        saveat=diffrax.SaveAt(subs=[diffrax.SubSaveAt(ts=times), diffrax.SubSaveAt(ts=between, fn=lowest)]),
        # The steps have no derivative: the clipped ones would be differentiated again and again.
        stepsize_controller=diffrax.ClipStepSizeController(
            controller, step_ts=(stops - jax.lax.stop_gradient(t0)) * jax.lax.stop_gradient(pace)
        ),
        adjoint=adjoint,
        max_steps=_STEPS,
        throw=False,
    )
    phases, lowest_between = cast(Any, raw.ys)
    states, loads = jax.vmap(dynamics.decode)(ts, phases), jax.vmap(dynamics.loads)(ts, phases)
    inertia = waves.inertia * jax.vmap(dynamics.inertia)(phases.a)
    turning = states.rate if states.planar else jnp.cross(states.direction, states.direction_rate)
    momentum = jax.vmap(jnp.multiply)(inertia, turning)
    energy = jax.vmap(dynamics.energy)(ts, phases)
    ended = diffrax.is_successful(raw.result) & jnp.all(jnp.isfinite(energy))
    tip = states.amplitudes @ waves.tip + loads @ waves.slack
    return _Run(states, tip, energy, momentum, loads, raw.stats["num_steps"], ended, jnp.min(lowest_between))


def _difference(fine: _Run, coarse: _Run) -> Errors:
    tip = jnp.abs(fine.tip - coarse.tip)
    one, other = fine.states, coarse.states
    if one.planar:
        return Errors(jnp.abs(one.angle - other.angle), jnp.abs(one.rate - other.rate), tip)

    def apart(x, y):
        return jnp.sqrt(jnp.sum((x - y) ** 2, axis=-1))

    chord, turning = apart(one.direction, other.direction), apart(one.direction_rate, other.direction_rate)
    return Errors(2 * jnp.arcsin(jnp.minimum(chord / 2, 1.0)), turning, tip)
