"""What accuracy costs in seven scenes that each teach something.

    python benchmarks/named_scenes.py [--seconds 90]

`jaxrod.tradeoff` on each scene of `jaxrod.scenes`, one after the other.  Writes the part "scenes" of docs/accuracy.md and a
picture of each, docs/tradeoff-NAME.png.
"""

import argparse
import pathlib

import jaxrod

jaxrod.configure()

import jax  # noqa: E402
import report  # noqa: E402

DOCS = pathlib.Path(__file__).parent.parent / "docs"
ADVICE = {
    "cone-started-suddenly": "A sudden start rings every overtone. Uniform strain has none of them, loses the phase of its one "
    "oscillation within a few periods, and no step size brings back what that does to the angle: after 2 s it is off by 0.23 "
    "rad, started steadily by 0.005. Take `LoadRitz(2)` or more: the second shape buys more digits than anything else here.",
    "cone-started-steadily": "The same cone, the same spin, already stretched by it: nothing rings. Uniform strain is off by "
    "0.005 rad where it was off by 0.23, and a strain that follows its loads (`QuasiStatic`) does as well. Start as the real "
    "rod starts; if it was brought up to speed slowly, say so (`static=True` here and in `plan`; `jaxrod.ladder.at_rest` makes "
    "the start).",
    "steel-link": "Steel under its own weight does not stretch enough to be seen. Take `Ritz(0)`: it is rigid, the cheapest "
    "by far, and its error is what 2 delta omega T foretells. Ask for more only if the stretch itself is wanted; then"
    " `QuasiStatic`.",
    "rotor-near-critical": "Near the critical spin the rod is soft, its strain far from uniform, and a few per cent of "
    "error in the frequency are a large error in the stretch. Uniform strain is of no use here; take three shapes or "
    "more, and look at `critical_rate` first.",
    "tether": "A light rod with a heavy tip stretches almost uniformly: one shape is right to the part in which the rod weighs "
    "less than its tip. What is left are overtones, weakly rung; two shapes see the first of them.",
    "impact": "A blow is a wave, and a fixed root doubles it: 2.00 times F / EA there. Uniform strain spreads the blow over the "
    "whole rod and finds 0.77, less than half, whatever the steps. What waves do in a section needs shapes as short as the "
    "wave: four or more; errors fall only like a power of their number, and the exact rod (`continuum.simulate`) is "
    "the tool. The elongation of the whole rod, and loads that last longer than a few axial periods, are kinder: a load "
    "that comes at once and stays doubles the static elongation, with one shape as in the exact rod.",
    "past-the-pole": "The director has no pole, and a pass beside the vertical costs no steps. The error is that of the start, "
    "which rings: one shape leaves millimetres to centimetres, three (`Ritz(3)`) hundredths of a millimetre at hardly more time. "
    "Take three shapes and the default's solver; fewer steps before fewer shapes.",
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
        jax.clear_caches()  # compiled programs are memory maps, of which there are 65,530
    report.write("scenes", "\n\n".join(parts), DOCS / "accuracy.md")


if __name__ == "__main__":
    main()
