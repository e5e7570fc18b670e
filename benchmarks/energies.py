"""What does it cost that the force comes from autodiff of the energies?

    python benchmarks/energies.py

The same loop, 64 lanes of the Figure 2 scene, 2200 steps of the same scheme: once with the kick that the library takes
from `energy.py` by automatic differentiation, once with the force written out by hand.  Writes the part "energies" of
docs/performance.md.
"""

import jaxrod

jaxrod.configure(cache=None)

import equinox as eqx  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import report  # noqa: E402

from jaxrod.core.lanes import alone, lanes_of, over_lanes, spread, widened  # noqa: E402
from jaxrod.mechanics.splittings.uniform_strain import UniformStrainSplitting  # noqa: E402

STEPS, LANES = 2200, 64


class ByHand(UniformStrainSplitting):
    """The flat split with its force written out."""

    def force(self, t, q):
        del t
        body, gravity = self.lean.body, self.lean.gravity
        assert gravity is not None
        pull = body.stiffness_matrix[0, 0] * (1 - 1 / jnp.sqrt(jnp.sum(q * q, axis=0)))
        return body.first_moments[0] * gravity - pull * q


def main() -> None:
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    solver, rates = jaxrod.BlanesMoan6(), jnp.linspace(14.0, 16.0, LANES)

    def run(kind):
        @jax.jit
        @jax.vmap
        def tips(rate):
            start = system.state(rate=rate)
            split = kind(system.discrete, 0.0, start)
            arrays, rest = eqx.partition((split, split.encode(start)), eqx.is_array)

            def loop(arrays):
                split, y = eqx.combine(arrays, rest)
                h = jnp.full(1, 10.0 / STEPS)
                y = widened(split.enter(solver, None, 0.0 * h, h, y), lanes_of(arrays))
                y = jax.lax.fori_loop(0, STEPS, lambda k, y: split.step(solver, None, k * h, h, y), y)
                return split.leave(solver, None, 10.0 + 0 * h, h, y).q

            return alone(over_lanes(loop)(spread(arrays)))

        return tips

    kinds = {"autodiff of the energies": run(UniformStrainSplitting), "written by hand": run(ByHand)}
    found = [kind(rates) for kind in kinds.values()]
    assert jnp.max(jnp.abs(found[0] - found[1])) < 1e-9, "not the same motion"
    times = report.paired({name: lambda k=kind: jax.block_until_ready(k(rates)) for name, kind in kinds.items()}, 31)
    least = times["written by hand"]
    rows = [[name, f"{1e9 * t / LANES / STEPS / 14:.2f}", f"{t / least:.2f}"] for name, t in times.items()]
    head = (
        "## Energies by autodiff\n\n`python benchmarks/energies.py`: one loop with both forces, medians of 31 runs.\n\n"
    )
    report.write("energies", head + report.table(["force", "ns per stage and lane", "ratio"], rows))


if __name__ == "__main__":
    main()
