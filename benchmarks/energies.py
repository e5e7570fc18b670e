"""What does it cost that the force comes from autodiff of the energies?

    python benchmarks/energies.py

The same loop, 64 lanes of the Figure 2 scene, 2200 steps of the same scheme: once with the kick that the library takes
from `energy.py` by automatic differentiation, once with the force written out by hand.  Writes the part "energies" of
docs/performance.md.
"""

import jaxrod

jaxrod.configure(cache=None)

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import report  # noqa: E402

from jaxrod.core.scalarize import Numbers  # noqa: E402
from jaxrod.mechanics.splittings.uniform_strain import Flat  # noqa: E402

STEPS, LANES = 2200, 64


class ByHand(Flat):
    """The flat split with its force written out."""

    def force(self, t, q: Numbers) -> Numbers:
        del t
        scene, _ = self.numbers
        x, y = q
        pull = scene.body.stiffness_matrix[0, 0] * (1 - 1 / jnp.sqrt(x * x + y * y))
        across, down = (scene.body.first_moments[0] * g for g in scene.gravity)
        return Numbers((across - pull * x, down - pull * y), (2,))


def main() -> None:
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    solver, rates = jaxrod.BlanesMoan6(), jnp.linspace(14.0, 16.0, LANES)

    def run(kind):
        @jax.jit
        @jax.vmap
        def tips(rate):
            start = system.state(rate=rate)
            split = kind(system.equations(jaxrod.Embedded()).scene, 0.0, start)
            h = 10.0 / STEPS
            y = split.opened(solver, None, 0.0, h, split.encode(start))
            y = jax.lax.fori_loop(0, STEPS, lambda k, y: split.step(solver, None, k * h, h, y), y)
            return jnp.stack(list(split.closed(solver, None, 10.0, h, y).q))

        return tips

    kinds = {"autodiff of the energies": run(Flat), "written by hand": run(ByHand)}
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
