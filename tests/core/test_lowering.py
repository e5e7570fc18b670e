"""What is left out is not computed, and the time loop calls neither LAPACK nor Python: read off the lowered programs.

Nothing is compiled or run here, programs are only lowered to StableHLO.  LAPACK, Python and whatever else lies outside
of the program are custom calls there; Cholesky's factorisation and the triangular solve are operations that become one.
"""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scene

import jaxrod

ROTATION, SPACE, SPIN = jaxrod.Rotation(), jaxrod.Spherical(), jaxrod.Driven(lambda t: 15.0 * t)
RIGID, ONE, TWO = (jaxrod.Ritz(n) for n in range(3))
TORQUE, FRICTION = jaxrod.Torque(1.0), jaxrod.PivotFriction(0.1)
heavy = functools.partial(scene, gravity=9.81)


# ---- the vector field


def lowered(chart=None, **keywords):
    """The acceleration of a scene; the rod is projected before, so its numbers are inputs."""
    system = heavy(**keywords)
    chart = jaxrod.default_chart(system) if chart is None else chart
    equations = jax.eval_shape(lambda: system.equations(chart))
    n = chart.size(system.motion) + (0 if isinstance(system.basis, jaxrod.QuasiStatic) else system.basis.n)
    number, vector = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((n,), float)
    field = jax.jit(lambda equations, t, q, v: equations.acceleration(t, q, v))
    return field.lower(equations, number, vector, vector)


def operations(**keywords):
    """Operations on arrays, however small."""
    return len(re.findall(r"= stablehlo\.", lowered(**keywords).as_text()))


def arithmetic(**keywords):
    """Additions and multiplications of numbers."""
    return lowered(**keywords).cost_analysis().get("flops", 0)


@pytest.mark.parametrize(
    "scenes",
    [
        pytest.param([{"gravity": None}, {}], id="gravity"),
        pytest.param([{"gravity": None, "motion": SPACE}, {"motion": SPACE}], id="gravity in space"),
        pytest.param([{"gravity": None, "motion": SPIN}, {"motion": SPIN}], id="gravity on a driven rod"),
        pytest.param([{}, {"forces": [FRICTION]}, {"forces": [FRICTION, TORQUE]}], id="forces"),
        pytest.param([{"motion": m, "chart": jaxrod.Angles()} for m in (ROTATION, SPACE)], id="space"),
        pytest.param([{"motion": m, "basis": TWO} for m in (ROTATION, SPACE)], id="space, by default charts"),
        pytest.param([{"motion": m} for m in (SPIN, ROTATION)], id="free turning"),
        pytest.param([{"basis": TWO}, {"basis": TWO, "law": jaxrod.law.neo_hookean}], id="strain law"),
    ],
)
@pytest.mark.parametrize("count", [operations, arithmetic])
def test_the_simpler_scene_costs_less(count, scenes):
    counts = [count(**scene) for scene in scenes]
    assert all(np.diff(counts) > 0), f"{counts} must increase"


@pytest.mark.parametrize("motion", [ROTATION, SPACE, SPIN])
def test_the_lower_rung_costs_less(motion):
    """A rigid rod has fewer operations; one strain or two have the same, on arrays of their size."""
    chart = jaxrod.Strains() if motion is SPIN else jaxrod.Angles()
    rungs = [{"motion": motion, "chart": chart, "basis": basis} for basis in (RIGID, ONE, TWO)]
    counts = [arithmetic(**rung) for rung in rungs]
    assert all(np.diff(counts) > 0), f"{counts} must increase"
    assert operations(**rungs[0]) < operations(**rungs[1])
    assert motion is not SPIN or counts[0] == 0, "a rigid rod has nothing left to move where it is driven"


def test_uniform_strain_in_space_is_cheapest():
    """In q = (1 + eps) d its kinetic energy is flat, which not even the rigid rod's is."""
    counts = [arithmetic(motion=SPACE, basis=basis) for basis in (ONE, RIGID, TWO)]
    assert all(np.diff(counts) > 0), f"{counts} must increase"


def test_the_rod_stays_out_of_the_time_loop():
    """Section, a body at the tip, the place of the pivot and the kind of shapes enter the set-up alone."""
    want = operations(basis=TWO)
    steps = jaxrod.Profile(jaxrod.PiecewiseConstant([0.4], [2e-3, 1e-3]), [0.4])
    for keywords in (
        {"section": jaxrod.Uniform(0.025)},
        {"section": steps},
        {"tip_mass": 0.5, "tip_inertia": 0.01},
        {"motion": jaxrod.Rotation(0.3)},
        {"basis": jaxrod.ForceRitz(2)},
    ):
        assert operations(**{"basis": TWO, **keywords}) == want, keywords


# ---- the time loop

OUTSIDE = ("custom_call", "cholesky", "triangular_solve")


def lowered_run(system):
    """A run from a start of traced numbers, as StableHLO."""

    def run(rate):
        return jaxrod.simulate(system, system.state(rate=rate), t1=1.0, throw=False)

    return jax.jit(run).lower(10.0).compiler_ir("stablehlo")


def inside(operation, functions, seen):
    """All operations in the regions of one, those of called functions too, each function but once."""
    for region in operation.regions:
        for block in region.blocks:
            for inner in block.operations:
                yield inner.operation
                yield from inside(inner.operation, functions, seen)
                callee = str(inner.operation.attributes["callee"])[1:] if inner.operation.name == "func.call" else None
                if callee is not None and callee not in seen:
                    seen.add(callee)
                    yield from inside(functions[callee], functions, seen)


def calls(module):
    """Loops of a program, and the operations that leave it: those within a loop, and all."""
    functions = {op.operation.attributes["sym_name"].value: op.operation for op in module.body.operations}
    everything = list(inside(functions["main"], functions, set()))
    loops = [op for op in everything if op.name == "stablehlo.while"]
    seen = set()
    within = [op for loop in loops for op in inside(loop, functions, seen)]
    return loops, *([named(op) for op in ops if op.name.split(".")[-1] in OUTSIDE] for ops in (within, everything))


def named(op):
    """What an operation is, and what it calls; to print it whole is to number its whole program."""
    return op.name, str(op.attributes["call_target_name"]) if "call_target_name" in op.attributes else ""


HOT = {
    "Ritz(1)": {},
    "Ritz(3)": {"basis": jaxrod.Ritz(3)},
    "Ritz(8)": {"basis": jaxrod.Ritz(8)},
    "ForceRitz(8)": {"basis": jaxrod.ForceRitz(8)},
    "spherical": {"motion": SPACE},
    "spherical, Ritz(3)": {"motion": SPACE, "basis": jaxrod.Ritz(3)},
    "QuasiStatic(Ritz(2))": {"basis": jaxrod.QuasiStatic(TWO)},
    "QuasiStatic(Ritz(8))": {"basis": jaxrod.QuasiStatic(jaxrod.Ritz(8))},
    "a law on Ritz(2)": {"basis": TWO, "law": jaxrod.law.green},
}


@pytest.mark.slow
@pytest.mark.parametrize("keywords", HOT.values(), ids=HOT)
def test_the_time_loop_calls_nothing(keywords):
    loops, within, everything = calls(lowered_run(heavy(**keywords)))
    assert loops, "a run is a loop"
    assert not within, within[:3]
    if keywords.get("basis", ONE).n > 1:
        assert everything, "the set-up factorises the mass matrix: this test must see such calls"


def solving(t, state):
    matrix = jnp.array([[2.0, 1.0], [1.0, 3.0]]) * (1 + t**2)
    return jnp.linalg.solve(matrix, state.direction)[0]


def factorising(t, state):
    return jnp.linalg.cholesky(jnp.array([[2.0, 1.0], [1.0, 3.0]]) * (1 + t**2))[1, 1]


def calling_back(t, state):
    return jax.pure_callback(np.cos, jax.ShapeDtypeStruct((), float), t)


def printing(t, state):
    jax.debug.print("{}", t)
    return t


@pytest.mark.parametrize("torque", [solving, factorising, calling_back, printing])
def test_a_call_in_the_time_loop_would_be_found(torque):
    _, within, _ = calls(lowered_run(heavy(forces=[jaxrod.Torque(torque)])))
    assert within
