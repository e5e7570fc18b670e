"""Annotations: there for all that is public, and right where the library runs."""

import inspect
import os
import subprocess
import sys

import pytest

import jaxrod

# Scenes of every kind, with every annotation checked as they run, shapes too.
PROGRAM = """
from jaxtyping import install_import_hook

with install_import_hook("jaxrod", "beartype.beartype"):
    import jaxrod
    import jaxrod.simulation

    said = jaxrod.configure(cache=None)
    import diffrax, jax, jax.numpy as jnp

    ball = {"tip_mass": 0.1, "tip_inertia": 0.01}
    cone = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), 1e7, 1200.0)

    def scene(motion=None, basis=None, rod=cone, **others):
        return jaxrod.System(rod, motion or jaxrod.Rotation(), basis, **others)

    def run(system, start=None, **how):
        sol = jaxrod.simulate(system, system.state(**(start or {})), t1=0.05, **how)
        return str(sol), sol.tip, str(sol.ledger), repr(system), repr(sol.states)

    hanging = scene(gravity=9.81)
    swing = hanging.state(rate=3.0)
    SCENES
    print("all right")
"""
KINDS = {
    "equal steps": """
    run(hanging, {"rate": 3.0})
    run(scene(jaxrod.Rotation(0.3), jaxrod.LoadRitz(2), gravity=[0.0, -9.81]))
    run(scene(basis=jaxrod.Ritz(0), gravity=9.81))
    run(scene(jaxrod.Spherical(), gravity=9.81), {"azimuth_rate": 2.0})
    run(scene(jaxrod.Driven(lambda t: 3.0 * t)))
    run(hanging, solver=jaxrod.QuinlanTremaine10(), n_steps=100)
    run(hanging, solver=jaxrod.Unrolled(), n_steps=20)
    run(scene(forces=[jaxrod.Torque(jaxrod.Impulse(1.0, 0.01, 0.01)), jaxrod.TipForce([1.0, 0.0])]))
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (hanging, swing))
    jaxrod.simulate(*single, t1=0.05)
    """,
    "steps that adapt": """
    for chart in (jaxrod.Angles(), jaxrod.Director(), jaxrod.Embedded()):
        run(hanging, chart=chart)
    run(scene(basis=jaxrod.QuasiStatic(jaxrod.Ritz(2)), gravity=9.81))
    run(scene(gravity=9.81, forces=[jaxrod.PivotFriction(0.1), jaxrod.KelvinVoigt(1e-3)]))
    run(hanging, event=diffrax.Event(lambda t, state, args, **_: state.angle + 0.1))
    pendulum = jaxrod.Lagrangian(lambda t, q, v: v @ v / 2 + jnp.cos(q[0]))
    jaxrod.simulate(pendulum, (jnp.array([1.0]), jnp.zeros(1)), t1=0.1)
    """,
    "sections and bodies": """
    for section in (
        jaxrod.Uniform(0.02),
        jaxrod.Table([0.0, 0.5, 1.0], radii=[0.1, 0.2, 0.1]),
        jaxrod.PiecewiseConstant([0.5], [1e-3, 2e-3]),
        lambda s: 1e-3 * (1 + s),
    ):
        run(scene(jaxrod.Flight(), jaxrod.ForceRitz(2), jaxrod.Rod(1.0, section, 1e7, 1200.0, **ball), gravity=9.81))
    run(scene(rod=jaxrod.Lumped(400.0, 300.0, 8000.0, 1.0)))
    run(scene(rod=jaxrod.Rod(1.0, jaxrod.Uniform(0.02), 1e7, 1200.0, law=jaxrod.law.neo_hookean), gravity=9.81))
    """,
    "statics, frequencies, the exact rod": """
    jaxrod.equilibrium(hanging, angle=1.0), str(jaxrod.modes(hanging)), jaxrod.natural_frequencies(hanging)
    jaxrod.critical_rate(hanging), jaxrod.frequency_error(hanging), str(jaxrod.model_limits(hanging))
    jaxrod.continuum.natural_frequencies(hanging, 3), jaxrod.continuum.steady_spin(scene(), 3.0)
    str(jaxrod.continuum.simulate(hanging, swing, ts=[0.05]))
    """,
    "derivatives, sweeps, errors, fits": """
    def end(rate):
        return jaxrod.simulate(hanging, hanging.state(rate=rate), t1=0.05).angle[-1]

    jax.grad(end)(3.0), jaxrod.sweep(end, jnp.array([1.0, 2.0]))
    str(jaxrod.simulate(hanging, swing, t1=0.05, budget=jaxrod.FinalTip()).budget)
    str(jaxrod.horizon(hanging, swing, t1=0.05, tolerance=1e-6))

    def frequencies(young):
        return jaxrod.natural_frequencies(scene(rod=jaxrod.Rod(1.0, jaxrod.Uniform(0.02), young, 1200.0)))

    repr(jaxrod.fit(frequencies, [20.0], sigma=[0.1], start=1e7))
    """,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_annotations_are_right(kind):
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("SCENES", KINDS[kind].strip())],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "EQX_ON_ERROR": "nan"},
    )
    assert run.returncode == 0 and "all right" in run.stdout, run.stderr[-3000:]


def _arguments(found) -> list[str]:
    """Those without an annotation."""
    given = inspect.signature(found).parameters.values()
    return [x.name for x in given if x.annotation is x.empty and x.name != "self"]


@pytest.mark.parametrize("name", [name for name in jaxrod.__all__ if name != "Result"])
def test_every_argument_is_annotated(name):
    found = getattr(jaxrod, name)
    of_modules = [x for x in vars(found).values() if getattr(x, "__module__", "") == getattr(found, "__name__", None)]
    for thing in of_modules if inspect.ismodule(found) else [found]:
        if not callable(thing) or getattr(thing, "__name__", "_").startswith("_"):
            continue
        assert not _arguments(thing), thing
        methods = vars(thing).items() if inspect.isclass(thing) else ()
        for method, function in methods:
            if inspect.isfunction(function) and (not method.startswith("_") or method == "__call__"):
                assert not _arguments(function), (thing, method)
