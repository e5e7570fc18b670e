"""How long until the first answer, of each verb?  Each in a process of its own with an empty compile cache, and once more.

    python benchmarks/first_answer.py [--repeats 3]

CPU seconds of the first call and of the second in the same process, without imports, over those of the first of a plain
`diffrax.diffeqsolve`: Dopri8, the rod of Figure 2 with one strain, accelerations by automatic differentiation of its
Lagrangian in polar coordinates.  The least of several processes.  And whole processes with a warm cache, over `import
diffrax`.  Writes the part "first answer" of docs/performance.md.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile

import report

SCENE = """
import jax, jax.numpy as jnp, diffrax, jaxrod
jaxrod.configure()
rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(root_radius=0.02, tip_radius=0.03), young=1e7, density=1200.0)
quantities = [jaxrod.FinalAngle(), jaxrod.FinalTip(), jaxrod.LargestStrain()]

def scene(basis):
    return jaxrod.System(rod, jaxrod.Rotation(), basis, gravity=9.81)

def run(basis, **how):
    system = scene(basis)
    return jaxrod.simulate(system, system.state(rate=15.0), t1=2.0, **how).angle.block_until_ready()

def gradient(basis):
    system = scene(basis)
    end = lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=2.0).angle[-1]
    return jax.jit(jax.grad(end))(15.0).block_until_ready()

def plan(tolerance):
    system = scene(jaxrod.Ritz(1))
    found = jaxrod.plan(system, system.state(rate=15.0), t1=2.0, quantity=jaxrod.FinalAngle(), tolerance=tolerance)
    assert found.met

def plain():
    inertia, moment, stiffness = (float(x) for x in (rod.moment_of_inertia(), rod.first_moment(), rod.stiffness))

    def lagrangian(q, v):
        stretch = 1 + q[1]
        kinetic = inertia * (stretch**2 * v[0] ** 2 + v[1] ** 2) / 2
        return kinetic - stiffness * q[1] ** 2 / 2 - 9.81 * moment * stretch * jnp.sin(q[0])

    def field(t, y, args):
        q, v = y
        carried = jax.jvp(lambda q: jax.grad(lagrangian, 1)(q, v), (q,), (v,))[1]
        return v, jnp.linalg.solve(jax.hessian(lagrangian, 1)(q, v), jax.grad(lagrangian)(q, v) - carried)

    controller = diffrax.PIDController(rtol=1e-10, atol=1e-10)

    @jax.jit
    def end(rate):
        start = jnp.zeros(2), jnp.array([rate, 0.0])
        term, solver = diffrax.ODETerm(field), diffrax.Dopri8()
        return diffrax.diffeqsolve(term, solver, 0.0, 2.0, None, start, stepsize_controller=controller, max_steps=100_000).ys

    jax.block_until_ready(end(15.0))
"""
MEASURE = """
import json, resource

def spent():
    return sum(resource.getrusage(resource.RUSAGE_SELF)[:2])

jnp.ones(3).block_until_ready()
found = []
for _ in range(2):
    began = spent()
    {call}
    found.append(spent() - began)
print(json.dumps([*found, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3]))
"""
CALLS = {
    "a plain diffeqsolve": "plain()",
    "simulate, Ritz(1)": "run(jaxrod.Ritz(1))",
    "simulate, LoadRitz(3)": "run(jaxrod.LoadRitz(3))",
    "simulate, LoadRitz(12)": "run(jaxrod.LoadRitz(12))",
    "jit(grad(simulate)), LoadRitz(3)": "gradient(jaxrod.LoadRitz(3))",
    "simulate with budget= of three quantities": "run(jaxrod.Ritz(1), budget=quantities)",
    "plan to 1e-4": "plan(1e-4)",
    "plan to 1e-6": "plan(1e-6)",
}


KINDS = """
import json, resource

scenes = {
    "a cone that swings": jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81),
    "in space": jaxrod.System(rod, jaxrod.Spherical(), gravity=9.81),
    "in flight": jaxrod.System(rod, jaxrod.Flight(), gravity=9.81),
    "driven, evenly": jaxrod.System(rod, jaxrod.Driven(lambda t: 15.0 * t)),
    "driven, faster and faster": jaxrod.System(rod, jaxrod.Driven(lambda t: 5.0 * t**2), jaxrod.LoadRitz(3)),
    "about a pivot inside": jaxrod.System(rod, jaxrod.Rotation(0.4), gravity=9.81),
    "a body at the tip": jaxrod.System(
        jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.02), young=1e7, density=1200.0, tip_mass=0.3), jaxrod.Rotation(),
        gravity=9.81,
    ),
    "of two materials": jaxrod.System(
        jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.02), young=jaxrod.PiecewiseConstant([0.5], [1e7, 1e8]), density=1200.0),
        jaxrod.Rotation(), gravity=9.81,
    ),
    "a force at the tip": jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81, forces=[jaxrod.TipForce(20.0)]),
    "a motor's torque": jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81, forces=[jaxrod.Torque(5.0)]),
}
spent = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
for name, system in scenes.items():
    start = system.state() if system.motion.prescribed else system.state(rate=8.0)
    for lap in range(2):
        began = spent()
        found = jaxrod.plan(system, start, t1=0.5, quantity=jaxrod.FinalTip(), tolerance=1e-4)
        lapse = spent() - began
        if not lap:
            first = lapse
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(json.dumps([name, repr(found).split(";")[0].split(": ", 1)[1], first, lapse, memory]))
"""


def process(code: str, cache: str) -> str:
    """What a process with this cache prints; everything of the library is imported before it begins."""
    environment = {**os.environ, "JAXROD_CACHE": cache, "EAGER_IMPORT": "1"}
    found = subprocess.run([sys.executable, "-c", code], check=True, env=environment, capture_output=True, text=True)
    return found.stdout


def first_calls(repeats: int) -> list[list[str]]:
    """Of each call: CPU s of the first and of the second, the ratio, the memory of its process."""
    found = {name: [] for name in CALLS}
    for _ in range(repeats):
        for name, call in CALLS.items():
            with tempfile.TemporaryDirectory() as empty:
                found[name].append(json.loads(process(SCENE + MEASURE.format(call=call), empty)))
    least = {name: [min(x) for x in zip(*rows, strict=True)] for name, rows in found.items()}
    unit = least["a plain diffeqsolve"][0]
    return [
        [name, f"{first:.2f}", f"{first / unit:.2f}", f"{second:.3f}", f"{memory:.0f}"]
        for name, (first, second, memory) in least.items()
    ]


def plans(unit: float) -> list[list[str]]:
    """Plans of ten kinds of scene in one process: CPU s of each, the second too, over `unit`, and the memory by then."""
    with tempfile.TemporaryDirectory() as empty:
        rows = map(json.loads, process(SCENE + KINDS, empty).splitlines())
    return [
        [name, found, f"{first:.2f}", f"{first / unit:.1f}", f"{second:.2f}", f"{memory:.0f}"]
        for name, found, first, second, memory in rows
    ]


def whole_processes(repeats: int) -> list[list[str]]:
    """CPU s of processes with a warm cache, imports and all."""
    bases = ("Ritz(1)", "LoadRitz(3)")
    codes = {"import diffrax": "import diffrax"}
    codes |= {f"simulate, {basis}": f"{SCENE}run(jaxrod.{basis})" for basis in bases}
    spent: dict[str, list[float]] = {name: [] for name in codes}
    with tempfile.TemporaryDirectory() as cache:
        for lap in range(repeats + 1):
            for name, code in codes.items():
                began = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
                environment = {**os.environ, "JAXROD_CACHE": cache}
                subprocess.run([sys.executable, "-c", code], check=True, env=environment, stdout=subprocess.DEVNULL)
                if lap:  # the first fills the cache
                    spent[name].append(sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - began)
    unit = min(spent["import diffrax"])
    return [[name, f"{min(found):.2f}", f"{min(found) / unit:.2f}"] for name, found in spent.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument(
        "--repeats", type=int, default=3, help="processes of each, of which the least counts (default 3)"
    )
    repeats = parser.parse_args().repeats
    calls = first_calls(repeats)
    head = ["call", "first, CPU s", "over the plain one", "second, CPU s", "memory, MB"]
    text = [
        "## First answer",
        "",
        "`python benchmarks/first_answer.py`: each call in a process of its own with an empty cache, imports apart; and again in "
        f"the same process. The least of {repeats} processes.",
        "",
        report.table(head, calls),
        "",
        "Plans to 1e-4 m of the tip after 0.5 s, one after the other in one process, over `simulate, Ritz(1)`:",
        "",
        report.table(
            ["scene", "plan", "first, CPU s", "over a run", "second, CPU s", "memory, MB"], plans(float(calls[1][1]))
        ),
        "",
        "Whole processes with a warm cache, imports and all:",
        "",
        report.table(["process", "CPU s", "over the first"], whole_processes(repeats)),
    ]
    report.write("first answer", "\n".join(text))


if __name__ == "__main__":
    main()
