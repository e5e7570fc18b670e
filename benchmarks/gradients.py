"""What does a derivative cost?  Forward sensitivities and the reversible adjoint against the run they differentiate.

    python benchmarks/gradients.py

Figure 2 for 10 s, 64 lanes, equal steps; the derivative of the tip's height by one parameter (the modulus) forwards, by
all (modulus, length, density, radii, gravity, rate) backwards.  The run that they differentiate has a rod for each lane;
beside it that of one rod, of which only the start differs.  Medians of runs in turn.  Writes the part "gradients" of
docs/performance.md.
"""

import jaxrod

jaxrod.configure(cache=None)

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import report  # noqa: E402

STEPS = {1: 2200, 3: 1200}


def main() -> None:
    rows = []
    for n, steps in STEPS.items():

        def height(p, adjoint=None, n=n, steps=steps):
            rod = jaxrod.Rod(p[1], jaxrod.Cone(0.02 * p[3], 0.03 * p[4]), young=1e7 * p[0], density=1200.0 * p[2])
            system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81 * p[5])
            solver = jaxrod.default_solver(system)
            start = system.state(rate=15.0 * p[6])
            return jaxrod.simulate(system, start, t1=10.0, solver=solver, n_steps=steps, adjoint=adjoint).tip[-1, 1]

        def forward(p, height=height):
            one = jnp.zeros(7).at[0].set(1.0)
            return jax.jvp(lambda p: height(p, diffrax.ForwardMode()), (p,), (one,))[1]

        def known(p, height=height):
            return height([*[1.0] * 6, p[6]])

        def by_start(p, height=height):
            return jax.grad(lambda rate: height([*p[:6], rate]))(p[6])

        lanes = jnp.ones((64, 7)).at[:, 6].set(jnp.linspace(0.93, 1.07, 64))
        ways = {"run, of one rod": known, "run": height, "forward, one parameter": forward}
        ways |= {"backwards, the start": by_start, "backwards, all seven": jax.grad(height)}
        runs = {name: jax.jit(jax.vmap(f)) for name, f in ways.items()}
        off = jnp.max(jnp.abs(runs["backwards, all seven"](lanes)[:, 0] / runs["forward, one parameter"](lanes) - 1))
        times = report.paired(
            {name: lambda f=f, lanes=lanes: jax.block_until_ready(f(lanes)) for name, f in runs.items()}, 9
        )
        for name, t in times.items():
            rows.append([f"Ritz({n})", name, f"{1e6 * t / 64:.0f}", f"{t / times['run']:.2f}"])
        rows.append([f"Ritz({n})", "forward and backwards differ by", f"{off:.0e}", ""])
    head = (
        "## Derivatives\n\n`python benchmarks/gradients.py`: Figure 2, 10 s, 64 lanes on one core. Forwards costs a run for "
        "each parameter; backwards, by running the steps back, all of them at once in memory that does not grow with the "
        "steps. Take `adjoint=diffrax.ForwardMode()` for one or two parameters, the default for more.\n\n"
    )
    report.write("gradients", head + report.table(["rod", "what", "us per trajectory", "over the run"], rows))


if __name__ == "__main__":
    main()
