"""What accuracy costs in seven scenes that each teach something.

    python benchmarks/named_scenes.py [--seconds 110] [--only NAME]

`jaxrod.tradeoff` on each scene of `jaxrod.scenes`, one after the other.  Writes the part "scenes", and one for each scene, of
docs/accuracy.md and a picture of each, docs/tradeoff-NAME.png.
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
    "rad, started steadily by 0.005. Take three shapes (`Ritz(3)`) or more: they cost little more than one, and buy more "
    "digits than anything else here.",
    "cone-started-steadily": "The same cone, the same spin, already stretched by it: nothing rings. With steps short enough "
    "uniform strain is off by 0.005 rad where it was off by 0.23 (docs/model_error.md); one shape of force (`ForceRitz(1)`) is "
    "nearer for hardly more time, and three are 10^4 times nearer. Start as the real rod starts; if it was brought up to speed "
    "slowly, say so (`static=True` here and in `plan`; `jaxrod.ladder.at_rest` makes the start).",
    "steel-link": "Steel under its own weight does not stretch enough to be seen. Take `Ritz(0)`: it is rigid, the cheapest by "
    "far, and off by less than the 2 delta omega T of a sudden start, as this one is steady. Ask for more only if the stretch "
    "itself is wanted; then `QuasiStatic`.",
    "rotor-near-critical": "Set at once to nine tenths of the critical spin this rod stretches to eight times its length, where "
    "no real one follows Hooke's law: what is to be seen is how soft it has become. Its strain is far from uniform, and a few "
    "per cent of error in the frequency are a large error in the stretch. Uniform strain is of no use here; take `LoadRitz(2)` "
    "or more shapes, and look at `critical_rate` first.",
    "tether": "A light rod with a heavy tip stretches almost uniformly: one shape brings the tip to micrometres, as the rod's "
    "own mass, a tenth of the body's, is all that it gets wrong. What is left are overtones, weakly rung; two or three shapes "
    "see the first of them.",
    "impact": "A blow is a wave, and a fixed root doubles it: 2.00 times F / EA there (by a half-sine of 0.72 travel times: of a "
    "step, which jumps, no modes have the strain to digits). Uniform strain spreads the blow over the whole rod and finds 0.77, "
    "less than half, whatever the steps. What waves do in a section needs shapes as short as the wave, and errors there do "
    "not fall evenly: one rung may be nearer than a richer one by chance. Take the exact rod (`continuum.simulate`), or a "
    "rung whose `budget` says that it is enough. The elongation of the whole rod, and loads that last longer than a few axial"
    " periods, are kinder: a load that comes at once and stays doubles the static elongation, with one shape as in the exact "
    "rod. A largest strain is looked for at 200 times, of which each is the end of a step: fewer steps are not tried.",
    "past-the-pole": "The director has no pole, and a pass beside the vertical costs no steps. The error is that of the start, "
    "which rings: one shape leaves millimetres to centimetres, three (`Ritz(3)`) hundredths of a millimetre at hardly more "
    "time. Take three shapes and the default's solver; fewer steps before fewer shapes.",
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=110.0, help="for each scene (default: 110)")
    parser.add_argument("--only", default="", choices=["", *jaxrod.scenes.NAMED], help="this scene alone")
    arguments = parser.parse_args()
    seconds, page = arguments.seconds, DOCS / "accuracy.md"
    text = (
        "## Speed for accuracy in named scenes\n\n"
        f"`python benchmarks/named_scenes.py --seconds {seconds:g}`, or `jaxrod tradeoff NAME` for one of them: rungs, "
        "solvers, steps and float types, one scene at a time; below, those that no other beats in both error and time, by a "
        "tenth or more. What is likeliest is tried first: the default on each rung, float32, other solvers, steps that adapt."
    )
    report.write("scenes", text, page)
    for name, make in jaxrod.scenes.NAMED.items():
        if arguments.only not in ("", name):
            continue
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
        text = (
            f"### {title}\n\n{ADVICE[name]}\n\nThe {found.quantity} after {scene.t1:g} s, from {found.reference}, itself good to "
            f"{found.own_error:.0e}.{left}\n\n![{title}](tradeoff-{name}.png)\n\n{report.table(head, rows)}"
        )
        report.write(f"scene {name}", text, page)
        jax.clear_caches()  # compiled programs are memory maps, of which there are 65,530


if __name__ == "__main__":
    main()
