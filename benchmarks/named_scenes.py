"""What accuracy costs in seven scenes that each teach something.

    python benchmarks/named_scenes.py [--seconds 90]

`jaxrod.tradeoff` on each scene of `jaxrod.scenes`, one after the other.  Writes the part "scenes" of docs/accuracy.md and a
picture of each, docs/tradeoff-NAME.png.
"""

import argparse
import pathlib

import jaxrod

jaxrod.configure()

import report  # noqa: E402

DOCS = pathlib.Path(__file__).parent.parent / "docs"
ADVICE = {
    "cone-started-suddenly": "A sudden start rings every overtone. Uniform strain has none of them, loses the phase of its one "
    "oscillation within a few periods, and no step size brings back what that does to the angle. Take `LoadRitz(2)` or more: the "
    "second shape buys more digits than anything else on this page.",
    "cone-started-steadily": "The same cone, the same spin, already stretched by it: nothing rings, and uniform strain or even a "
    "strain that follows its loads (`QuasiStatic`) is good for most purposes. Start as the real rod starts; if it was "
    "brought up to speed slowly, say so (`at_rest`, `equilibrium(spin=)`).",
    "steel-link": "Steel under its own weight does not stretch enough to be seen. Take `Ritz(0)`: it is rigid, the cheapest "
    "by far, and its error is what 2 delta omega T foretells. Ask for more only if the stretch itself is wanted; then"
    " `QuasiStatic`.",
    "rotor-near-critical": "Near the critical spin the rod is soft, its strain far from uniform, and a few per cent of "
    "error in the frequency are a large error in the stretch. Uniform strain is of no use here; take three shapes or "
    "more, and look at `critical_rate` first.",
    "tether": "A light rod with a heavy tip stretches almost uniformly: one shape is right to the part in which the rod weighs "
    "less than its tip. What is left are overtones, weakly rung; two shapes see the first of them.",
    "impact": "The largest elongation of the whole rod comes out right with one shape: a load that comes at once doubles "
    "the static one, in the exact rod as in the model. When that is, and what a section in between feels, does "
    "not: a kink runs up and down the rod, and errors of that fall only like a power of the number of shapes. "
    "Then take `ForceRitz`, which can hold a force at the tip, before `LoadRitz`; for the kink itself the exact "
    "rod (`continuum.simulate`).",
    "past-the-pole": "In space there is no pole for the director. The trade is that of the plane: rungs for the start's "
    "ringing, then the fewest steps of a symplectic solver.",
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=90.0, help="for each scene (default: 90)")
    seconds = parser.parse_args().seconds
    parts = [
        "## Speed for accuracy in named scenes\n\n"
        f"`python benchmarks/named_scenes.py --seconds {seconds:g}`, or `jaxrod tradeoff NAME` for one of them: rungs, "
        "solvers, steps and float types, one scene at a time; below, those that no other beats in both error and time."
    ]
    for name, make in jaxrod.scenes.NAMED.items():
        scene = make()
        found = jaxrod.tradeoff(
            scene.system, scene.start, t1=scene.t1, quantity=scene.quantity, static=scene.static, seconds=seconds
        )
        jaxrod.plot.tradeoff(found, scene.title).savefig(DOCS / f"tradeoff-{name}.png", dpi=110)
        rows = [
            [row.rung, row.solver, row.dtype, str(row.steps), f"{row.error:.1e}", f"{1e3 * row.cost:.3g}"]
            for row in found.front
        ]
        head = ["rung", "solver", "type", "steps", f"error, {found.unit}".rstrip(", "), "ms / s"]
        title = scene.title[0].upper() + scene.title[1:]
        left = f" No time was left for {found.left} ways." if found.left else ""
        parts.append(
            f"### {title}\n\n{ADVICE[name]}\n\nThe {found.quantity} after {scene.t1:g} s, from {found.reference}, itself good to "
            f"{found.own_error:.0e}.{left}\n\n![{title}](tradeoff-{name}.png)\n\n{report.table(head, rows)}"
        )
        print(parts[-1], flush=True)
    report.write("scenes", "\n\n".join(parts), DOCS / "accuracy.md")


if __name__ == "__main__":
    main()
