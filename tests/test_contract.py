"""What callers rely on: names, configuration, shapes, Diffrax's keywords, forces, and what simpler scenes leave out."""

import dataclasses
import doctest
import functools
import importlib
import os
import pkgutil
import re
import subprocess
import sys

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod
from jaxrod import Result

# ---- names

NAMES = [
    "ABA864",
    "AbstractForce",
    "AbstractMotion",
    "AbstractQuantity",
    "Angles",
    "BlanesMoan4",
    "BlanesMoan6",
    "Budget",
    "Cone",
    "CustomQuantity",
    "Director",
    "Driven",
    "Embedded",
    "FinalAngle",
    "FinalTip",
    "FirstFrequency",
    "Fit",
    "Flight",
    "ForceRitz",
    "Horizon",
    "Impulse",
    "KelvinVoigt",
    "Lagrangian",
    "LargestStrain",
    "Ledger",
    "LoadRitz",
    "Local",
    "Lumped",
    "Measured",
    "ModelLimits",
    "Modes",
    "PiecewiseConstant",
    "PivotFriction",
    "Plan",
    "Positive",
    "Profile",
    "QuasiStatic",
    "QuinlanTremaine10",
    "QuinlanTremaine12",
    "Record",
    "Result",
    "Reversible",
    "Ritz",
    "Rod",
    "Rotation",
    "ShakenBase",
    "SimulationError",
    "Solution",
    "Spherical",
    "State",
    "Steps",
    "StormerVerlet",
    "Strains",
    "System",
    "Table",
    "TipForce",
    "Torque",
    "Tradeoff",
    "Uniform",
    "Unrolled",
    "claims",
    "configure",
    "continuum",
    "critical_rate",
    "default_chart",
    "default_solver",
    "energy",
    "equilibrium",
    "fit",
    "frequency_error",
    "horizon",
    "ladder",
    "law",
    "model_limits",
    "modes",
    "natural_frequencies",
    "paper",
    "plan",
    "plot",
    "scenes",
    "simulate",
    "sweep",
    "tradeoff",
]


def test_public_names():
    """A name more or less is a decision, written here and in `__init__.pyi`."""
    assert sorted(jaxrod.__all__) == NAMES
    assert set(NAMES) <= set(dir(jaxrod))
    assert jaxrod.__version__


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there(name):
    assert getattr(jaxrod, name) is not None


def test_no_name_that_is_not_there():
    with pytest.raises(AttributeError, match="Simulate"):
        jaxrod.Simulate  # noqa: B018


# ---- import and configure, each in a process of its own


def _python(program):
    own = {name: x for name, x in os.environ.items() if name not in ("XLA_FLAGS", "EQX_ON_ERROR")}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, env=own)
    assert run.returncode == 0, run.stderr
    return run.stdout.splitlines()


def test_import_imports_nothing():
    said = _python(
        "import os, sys; before = dict(os.environ); import jaxrod\n"
        "print([m for m in ('jax', 'jaxlib', 'equinox', 'diffrax', 'numpy', 'matplotlib') if m in sys.modules])\n"
        "print(before == dict(os.environ))"
    )
    assert said == ["[]", "True"]


def test_places_of_extremes():
    """Two `argmax` of like shape, which ended the process on jaxlib 0.10, and the first of equals, NaN before all."""
    said = _python(
        "import jaxrod; jaxrod.configure(cache=None)\n"
        "import jax, jax.numpy as jnp, numpy as np\n"
        "x = np.array([[1.0, 3, 3], [np.nan, 5, np.nan], [-np.inf, -np.inf, 0], [2, np.inf, np.nan]])\n"
        "both = jax.jit(lambda x: [jnp.argmax(k * x, 1) for k in (1.0, 2.0, -1.0)] + [jnp.argmin(x, 1), jnp.argmax(x)])\n"
        "print(all(np.array_equal(a, b) for a, b in zip(both(x), [*(np.argmax(k * x, 1) for k in (1, 2, -1)), "
        "np.argmin(x, 1), np.argmax(x)])))"
    )
    assert said == ["True"]


@pytest.mark.slow
def test_several_runs_in_one_sweep_as_users_compile_them():
    """With XLA's optimizations, which the other tests are without: three runs of a rung in one program."""
    program = (
        "import jaxrod; jaxrod.configure(cache=None)\n"
        "import dataclasses, jax.numpy as jnp\n"
        "rod = jaxrod.Rod(1.0, jaxrod.Cone(0.03, 0.01), young=1e7, density=1200.0)\n"
        "def tips(x, steps=None):\n"
        "    stiffer = dataclasses.replace(rod, young=rod.young * (1 + x))\n"
        "    system = jaxrod.System(stiffer, jaxrod.Rotation(), jaxrod.Ritz(3), 9.81)\n"
        "    return jaxrod.simulate(system, system.state(rate=5.0), t1=0.05, n_steps=steps, throw=False).tip[-1]\n"
        "a, b, c = jaxrod.sweep(lambda x: (tips(x), tips(x, 400), tips(x + 0.5)), jnp.linspace(0, 1, 100))\n"
        "print(float(jnp.max(jnp.abs(a - b))) < 1e-9, float(jnp.max(jnp.abs(a[50:] - c[:50]))) < 0.05)"
    )
    assert _python(program) == ["True True"]


def test_names_set_nothing():
    """Using the library without `configure` leaves JAX as it was: float32."""
    said = _python(
        "import jaxrod, jax; before = dict(jax.config.values)\n"
        "rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.02), 1e7, 1200.0)\n"
        "print(jaxrod.System(rod, jaxrod.Rotation()).state(angle=1.0).angle.dtype, dict(jax.config.values) == before)"
    )
    assert said == ["float32 True"]


def test_configure(tmp_path):
    said = _python(
        f"import jaxrod; said = jaxrod.configure(cache={str(tmp_path)!r}, devices=2); print(said)\n"
        "import jax; print(jax.numpy.zeros(()).dtype, jax.device_count(), jax.config.jax_compilation_cache_dir)\n"
        "import warnings; warnings.simplefilter('error'); print(jaxrod.configure() == said)\n"
        "try: jaxrod.configure(x64=False)\n"
        "except UserWarning as warning: print(str(warning)[:43])\n"
        "print(jax.numpy.zeros(()).dtype)"
    )
    assert said == [
        f"jaxrod: float64, 2 CPU devices, compiled programs kept in {tmp_path}, loops compiled whole",
        f"float64 2 {tmp_path}",
        "True",
        "configure() was called before, and stays: j",
        "float64",
    ]


def test_second_process_finds_its_programs(tmp_path):
    """Nothing that one process compiled is compiled by the next."""
    program = (
        "import collections, jax; seen = collections.Counter()\n"
        "jax.monitoring.register_event_listener(lambda event, **_: seen.update([event.split('/')[-1]]))\n"
        f"import jaxrod; jaxrod.configure(cache={str(tmp_path)!r})\n"
        "rod = jaxrod.Rod(1.0, jaxrod.Uniform(0.02), 1e7, 1200.0)\n"
        "system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)\n"
        "jaxrod.sweep(lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=0.1).tip, jax.numpy.ones(3))\n"
        "print(seen['cache_misses'], seen['cache_hits'])"
    )
    (missed, _), (missed_again, found) = (map(int, _python(program)[0].split()) for _ in range(2))
    assert missed > 0 and missed_again == 0 and found >= missed


@pytest.mark.parametrize(
    ("before", "call", "complaint"),
    [
        ("", "devices=0", "devices=0 must be a positive whole number"),
        ("import os; os.environ['JAX_PLATFORMS'] = 'tpu'", "", "JAX_PLATFORMS=tpu leaves out the CPU"),
    ],
)
def test_configure_refuses(before, call, complaint):
    said = _python(f"{before}\nimport jaxrod\ntry: jaxrod.configure({call})\nexcept Exception as error: print(error)")
    assert said[0].startswith(complaint)


def test_configure_says_where_it_keeps_nothing(tmp_path):
    (tmp_path / "file").touch()
    said = _python(
        "import os; os.environ['JAXROD_CACHE'] = "
        f"{str(tmp_path / 'file')!r}\nimport jaxrod; print(jaxrod.configure()); import jax\n"
        "print(jax.config.jax_compilation_cache_dir)"
    )
    assert "compiled programs NOT kept" in said[0] and said[1] == "None"


def test_configure_without_cache_in_float32():
    said = _python(
        "import jaxrod; print(jaxrod.configure(x64=False, cache=None, devices=1)); import jax; print(jax.numpy.zeros(()).dtype)"
    )
    assert said == ["jaxrod: float32, 1 CPU device, loops compiled whole", "float32"]


def test_configure_comes_first():
    """After the first computation some settings would be ignored: it says so, and sets none of them."""
    said = _python(
        "import jax, jaxrod; jax.numpy.zeros(2) + 1\n"
        "try: jaxrod.configure(cache=None)\n"
        "except RuntimeError as error: print(error)\n"
        "import os; print(jax.config.jax_enable_x64, *(x in os.environ for x in ('XLA_FLAGS', 'EQX_ON_ERROR')))"
    )
    assert said[0].startswith("jaxrod.configure() came after JAX's first computation; call it before anything else")
    assert said[1:] == ["False False False"]


# ---- examples in docstrings


_LONG_TO_COMPILE = (
    "basis.QuasiStatic",
    "continuum.simulation.converged",
    "continuum.simulation.simulate",
    "force.ShakenBase",
    "force.TipForce",
    "force.Torque",
    "modal.modes",
    "planning.plan",
    "signal.Record",
    "statics.equilibrium",
    "tradeoff.tradeoff",
)


def _examples():
    for module in pkgutil.walk_packages(jaxrod.__path__, "jaxrod."):
        if not module.name.endswith("__main__"):
            for test in doctest.DocTestFinder(exclude_empty=True).find(importlib.import_module(module.name)):
                if test.examples:
                    name = test.name.removeprefix("jaxrod.")
                    yield pytest.param(test, id=name, marks=pytest.mark.slow if name in _LONG_TO_COMPILE else ())


@pytest.mark.parametrize("example", _examples())
def test_docstrings(example):
    said = []
    with jax.numpy_rank_promotion("allow"):  # an example is a user's program
        doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example, out=said.append)
    assert not said, "".join(said)


# ---- forces, and what a solution looks like, for each motion

DURATION = 0.2
X, W = np.polynomial.legendre.leggauss(60)
TIMES = jnp.asarray(np.concatenate([(X + 1) * DURATION / 2, [DURATION]]))
MOTIONS = {
    "Rotation": (jaxrod.Rotation(0.1), jaxrod.Torque(8.0), {"angle": 0.5, "rate": 9.0}),
    "Spherical": (
        jaxrod.Spherical(0.1),
        jaxrod.Torque(jnp.array([3.0, -5.0, 8.0])),
        {"angle": 0.5, "rate": 9.0, "azimuth": 1.0, "azimuth_rate": 7.0},
    ),
    "Flight": (
        jaxrod.Flight(),
        jaxrod.Torque(8.0),
        {"angle": 0.5, "rate": 9.0, "center": (1.0, 2.0), "center_velocity": (3.0, 4.0)},
    ),
}


@functools.cache
def _forced(name):
    motion, torque, numbers = MOTIONS[name]
    forces = (torque,) if name == "Flight" else (torque, jaxrod.PivotFriction(0.3))
    system = scene(motion, jaxrod.Ritz(1), 9.81, forces)
    return jaxrod.simulate(system, system.state(strain=0.02, **numbers), ts=TIMES)


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTIONS)
def test_power_balance(name):
    """Energy changes by the power of torque and friction, and by nothing else: Gauss' rule over the whole run."""
    sol = _forced(name)
    state = sol.states
    moment = MOTIONS[name][1].moment
    turning = np.cross(state.direction, state.direction_rate) if name == "Spherical" else sol.rate
    power = turning @ moment if name == "Spherical" else turning * moment
    if name != "Flight":
        power = power - 0.3 * (state.direction_rate**2).sum(axis=-1)
    work = DURATION / 2 * W @ power[:-1]
    start = sol.system.energy(sol.system.state(strain=0.02, **MOTIONS[name][2]))
    assert abs(work) > 0.5  # J: there is something to balance
    np.testing.assert_allclose(sol.energy[-1] - start, work, rtol=0, atol=1e-8 * abs(start))


@pytest.mark.parametrize("name", MOTIONS)
def test_shapes(name):
    """T times first, then what belongs to one time."""
    sol, T, D = _forced(name), TIMES.size, 3 if name == "Spherical" else 2
    expected = {
        "ts": (T,), "angle": (T,), "rate": (T,), "director": (T, D), "strain": (T,), "strain_rate": (T,), "tip": (T, D),
        "energy": (T,), "angular_momentum": (T, 3) if D == 3 else (T,),
    }  # fmt: skip
    assert {key: getattr(sol, key).shape for key in expected} == expected
    assert sol.shape(jnp.linspace(0.0, 1.0, 5)).shape == (T, 5, D)
    state = {
        "direction": (T, D),
        "direction_rate": (T, D),
        "amplitudes": (T, 1),
        "amplitude_rates": (T, 1),
        "turns": (T,),
    }
    if name == "Flight":
        state |= {"center": (T, 2), "center_velocity": (T, 2)}
        assert sol.center.shape == (T, 2)
    else:
        assert sol.center is None
    assert {key: x.shape for key, x in vars(sol.states).items() if x is not None} == state
    if D == 3:
        assert sol.azimuth.shape == sol.azimuth_rate.shape == (T,)
    assert sol.ok and sol.result == Result.ok and Result[sol.result] == "the run reached its end"
    assert set(sol.stats) == {"num_steps", "num_accepted_steps", "num_rejected_steps", "t_end", "step", "why"}
    assert sol.stats["num_steps"] == sol.stats["num_accepted_steps"] + sol.stats["num_rejected_steps"] > 0
    assert sol.stats["t_end"] == DURATION
    np.testing.assert_allclose(sol.tip, sol.shape(jnp.array([1.0]))[:, 0], rtol=1e-14)


def test_print():
    """A few short lines: where it went, how, and what the model leaves out."""
    number = r"-?\d[\d.e+-]*"
    lines = (
        rf"61 times to t = 0\.2 s by Dopri8, Embedded, \d+ steps in float64: the run reached its end\n"
        rf" +angle: {number} \.\. {number} rad\n"
        rf" +strain: {number} \.\. {number}\n"
        rf" +energy: {number} \.\. {number} J\n"
        rf"left out: bending, {number} Hz \(axial {number} Hz\), at up to {number} turns a second"
    )
    sol = _forced("Spherical")
    assert re.fullmatch(lines, str(sol)), str(sol)
    low, high = re.search(r"strain: (\S+) \.\. (\S+)\n", str(sol)).groups()
    np.testing.assert_allclose([float(low), float(high)], [sol.strain.min(), sol.strain.max()], rtol=1e-5)


def test_friction_of_a_rigid_rod():
    """Without gravity the rate decays as exp(-c t / I): closed form."""
    system = scene(basis=jaxrod.Ritz(0), forces=(jaxrod.PivotFriction(0.5),))
    ts = jnp.linspace(0.0, 3.0, 4)
    sol = jaxrod.simulate(system, system.state(rate=4.0), ts=ts)
    np.testing.assert_allclose(sol.rate, 4.0 * np.exp(-0.5 * ts / system.rod.moment_of_inertia()), rtol=1e-9)


# ---- Diffrax's own keywords


@pytest.fixture(scope="module")
def figure_2():
    system = scene(gravity=9.81)
    return system, system.state(rate=15.0)


@pytest.fixture(scope="module")
def reference(figure_2):
    return jaxrod.simulate(*figure_2, ts=jnp.array([0.05, 0.1]), tolerance=1e-12)


def test_keywords_pass_through(figure_2, reference, capsys):
    """Solver, step size controller, first step, saving and meter in one run: all five are heard."""
    seen = []

    def save(t, state, args):
        seen.append(type(state))
        return {"t": t, "angle": state.angle}

    sol = jaxrod.simulate(
        *figure_2, t1=0.1, solver=diffrax.Tsit5(), stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-6), dt0=1e-5,
        saveat=diffrax.SaveAt(ts=reference.ts, fn=save), progress_meter=diffrax.TextProgressMeter(),
    )  # fmt: skip
    jax.effects_barrier()
    assert set(seen) == {jaxrod.State}
    assert sol.method == "Tsit5, Angles"
    np.testing.assert_array_equal(sol.states["t"], reference.ts)
    error = np.abs(sol.states["angle"] - reference.angle).max()
    assert 1e-12 < error < 1e-4  # as rough as asked for
    assert "100.00%" in capsys.readouterr().out


@pytest.mark.parametrize("chart", [jaxrod.Angles(), jaxrod.Embedded()], ids=["Angles", "Embedded"])
def test_implicit_solver(figure_2, reference, chart):
    """Kvaerno5 solves for its stages: it needs Jacobians of the accelerations."""
    sol = jaxrod.simulate(*figure_2, ts=reference.ts, solver=diffrax.Kvaerno5(), chart=chart)
    assert sol.method == f"Kvaerno5, {type(chart).__name__}"
    np.testing.assert_allclose(sol.tip, reference.tip, rtol=0, atol=1e-8)


def test_save_every_step_of_constant_length(figure_2):
    """dt0 alone means constant steps; room that is not needed is NaN.  The adjoint is another one."""
    sol = jaxrod.simulate(
        *figure_2,
        t1=0.1,
        dt0=0.0025,
        saveat=diffrax.SaveAt(t0=True, steps=True),
        max_steps=64,
        adjoint=diffrax.DirectAdjoint(),
    )
    assert sol.stats["num_steps"] == 40
    reached = np.isfinite(sol.ts)
    # Diffrax writes the last step twice where an event may end the run
    np.testing.assert_allclose(np.unique(sol.ts[reached]), 0.0025 * np.arange(41), rtol=1e-12)
    assert np.isfinite(sol.angle[reached]).all()
    assert (~reached).sum() > 20 and np.isnan(sol.angle[~reached]).all()


def test_event(figure_2):
    """A run stops when the rod passes 3 rad, whatever the step: the time is that of a run that ends there."""
    event = diffrax.Event(lambda t, state, args, **_: state.angle - 3.0, direction=True)
    sol = jaxrod.simulate(*figure_2, t1=1.0, event=event)
    assert sol.result == Result.ok and 0.2 < sol.ts[0] < 0.25
    assert sol.stats["t_end"] == sol.ts[0]
    np.testing.assert_allclose(sol.angle, 3.0, rtol=1e-12)
    again = jaxrod.simulate(*figure_2, ts=jnp.array([0.1, sol.ts[0]]), tolerance=1e-12)
    np.testing.assert_allclose(again.angle[-1], 3.0, rtol=0, atol=1e-8)


# ---- new scenes from old ones


def test_replaced_scenes_are_right(figure_2):
    """Only inputs are stored, so nothing is left over from the old scene."""
    system, _ = figure_2
    numbers = {"length": 2.0, "section": jaxrod.Uniform(0.01), "young": 3e7, "density": 900.0}
    built = scene(jaxrod.Spherical(0.5), gravity=1.6, **numbers)
    rod = dataclasses.replace(system.rod, **numbers)
    replaced = dataclasses.replace(system, rod=rod, motion=jaxrod.Spherical(0.5), gravity=1.6)
    grown = eqx.tree_at(lambda s: (s.rod.length, s.motion.pivot), replaced, (jnp.array(4.0), jnp.array(1.0)))
    state = built.state(angle=0.5, rate=3.0, strain=0.1)
    assert replaced.energy(state) == built.energy(state) != system.energy(system.state(angle=0.5, rate=3.0, strain=0.1))
    np.testing.assert_array_equal(jaxrod.natural_frequencies(replaced), jaxrod.natural_frequencies(built))
    # twice as long about a pivot twice as far: half the frequency, and the tip twice as far out
    np.testing.assert_allclose(jaxrod.natural_frequencies(grown), jaxrod.natural_frequencies(built) / 2, rtol=1e-13)
    np.testing.assert_allclose(grown.tip(state), 2 * built.tip(state), rtol=1e-14)


# ---- what is left out is not computed


def _operations(n=1, gravity: float | None = 9.81, forces=(), motion=None):
    """Operations of the lowered acceleration."""
    system = scene(motion, jaxrod.Ritz(n), gravity, forces)
    chart = jaxrod.Angles()
    q, v = chart.encode(system.motion, system.state(angle=0.3, rate=1.0))
    program = jax.jit(lambda q, v: system.lagrangian(chart).acceleration(0.0, q, v)).lower(q, v)
    return len(program.as_text().splitlines())


@pytest.mark.parametrize("motion", [jaxrod.Rotation(), jaxrod.Spherical()], ids=["plane", "space"])
def test_simpler_scenes_are_shorter_programs(motion):
    full = {"forces": (jaxrod.PivotFriction(0.1),), "motion": motion}
    assert _operations(**full, gravity=None) < _operations(**full)
    assert _operations(motion=motion) < _operations(**full)
    assert _operations(**full, n=0) < _operations(**full)
    assert _operations(n=0, gravity=None, motion=motion) < _operations(n=0, motion=motion)


# ---- names of before


def test_old_names_warn_and_work():
    with pytest.warns(FutureWarning, match=r"jaxrod\.Steps is called jaxrod\.PiecewiseConstant now") as said:
        old = jaxrod.Steps([0.4], [2e-3, 1e-3])
    assert said[0].filename == __file__ and isinstance(old, jaxrod.PiecewiseConstant)
    rods = [jaxrod.Rod(1.0, area, 1e7, 1200.0) for area in (old, jaxrod.PiecewiseConstant([0.4], [2e-3, 1e-3]))]
    assert rods[0].mass == rods[1].mass and rods[0].breaks == (0.4,)
    with pytest.warns(FutureWarning, match=r"jaxrod\.Measured is called jaxrod\.CustomQuantity now") as said:
        old = jaxrod.Measured(lambda sol: sol.energy[-1], "J")
    assert said[0].filename == __file__ and old.unit == "J"
