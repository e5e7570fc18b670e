"""What does each number behind the default's steps buy?  Errors, runs that end ok and steps, with it halved and doubled.

    python benchmarks/step_policy.py [--scenes 1600] [--seed 1]

The scenes of random_extremes.py, in float64, of four kinds.  Each runs by the library's own `StepPolicy`, then with one number of
it halved, then doubled, all in one program.  The reference is half the step; a scene counts where `random_extremes.verdict`
judges it, within its horizon.  Writes docs/step_policy.md.
"""

import argparse
import dataclasses
import pathlib
from typing import Any

import jaxrod

jaxrod.configure()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import random_extremes  # noqa: E402
import report  # noqa: E402
from random_extremes import Kind  # noqa: E402

from jaxrod.runs.execution import Request, execute  # noqa: E402
from jaxrod.runs.step_policy import StepPolicy  # noqa: E402

PAGE = pathlib.Path(__file__).parent.parent / "docs" / "step_policy.md"
KINDS = [Kind("Rotation", 1), Kind("Rotation", 3), Kind("Spherical", 1), Kind("Driven", 3)]
FACTORS = (0.5, 2.0)
FIELDS = [field.name for field in dataclasses.fields(StepPolicy) if field.name != "each_radian"]  # 0 in float64


def scaled(field: str, factor: float) -> StepPolicy:
    """The policy with one number of it multiplied."""
    policy = StepPolicy()
    values = {field: jax.tree.map(lambda x: x * factor, getattr(policy, field))}
    return dataclasses.replace(policy, **values)


def run(kind: Kind, p: dict, known: dict, policy: StepPolicy) -> dict:
    """One scene by a policy."""
    system, start, ts = random_extremes.scene(kind, p)
    asked = Request.checked(system, start, ts=ts, max_steps=random_extremes.LONGEST)
    return random_extremes._found(execute(asked, policy), known)


def measured(kind: Kind, p: dict) -> dict[str, dict[str, np.ndarray]]:
    """By each policy: which scenes are ok, silently wrong, how far off, and how many steps they took."""
    count = len(p["young"])

    def each(function, *inputs) -> Any:
        return jaxrod.sweep(lambda x: function(kind, *x), inputs, order_by=p["periods"], progress=False)

    _, known = each(random_extremes.yardstick, p)
    grown = each(random_extremes.growth, p, known)
    policies = {"": StepPolicy()} | {
        f"{field} {factor:g}": scaled(field, factor) for field in FIELDS for factor in FACTORS
    }
    out = {}
    for name, policy in policies.items():
        lanes = jax.tree.map(lambda x: jnp.full(count, x), policy)  # numbers, not constants: one program for all
        found = each(run, p, known, lanes)
        seen = random_extremes.verdict("float64", {**found, "growth": grown})
        told = seen["ok"] & ~seen["beyond"] & ~seen["unjudged"]
        margin = np.where(told, seen["margin"], 0.0)
        out[name] = {
            "ok": seen["ok"],
            "wrong": seen["wrong"],
            "margin": margin,
            "steps": np.asarray(found["steps"], float),
        }
    return out


def cell(found: dict[str, np.ndarray], own: dict[str, np.ndarray]) -> list[str]:
    """Silently wrong, the largest error over its promise, of 100 that end ok, steps of those that do by both."""
    both = found["ok"] & own["ok"]
    steps = np.exp(np.mean(np.log(np.maximum(found["steps"][both], 1) / np.maximum(own["steps"][both], 1))))
    return [
        f"{found['wrong'].sum()}",
        f"{found['margin'].max():.2g}",
        f"{100 * found['ok'].mean():.1f}",
        f"{steps:.2f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--scenes", type=int, default=1600, help="how many, over all kinds (default 1600)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    arguments = parser.parse_args()
    rng, parts = np.random.default_rng(arguments.seed), []
    for kind in KINDS:
        with report.quiet():
            parts.append(measured(kind, random_extremes.draw(kind, arguments.scenes // len(KINDS), rng)))
        jax.clear_caches()
        print(kind, flush=True)
    whole = {
        name: {key: np.concatenate([part[name][key] for part in parts]) for key in parts[0][name]} for name in parts[0]
    }
    own, policy, rows = whole[""], StepPolicy(), []
    for field in FIELDS:
        value = getattr(policy, field)
        number = value["float64"] if isinstance(value, dict) else value
        cells = [cell(whole[f"{field} {factor:g}"], own) for factor in FACTORS]
        rows.append([f"`{field}`", f"{number:.3g}", *cells[0], *cells[1]])
    counted = int(np.sum(own["ok"]))
    head = [
        "number",
        "is",
        *(f"{what}, {by}" for by in ("halved", "doubled") for what in ("wrong", "error", "% ok", "steps")),
    ]
    report.write(
        "policy",
        "\n".join(
            [
                f"`python benchmarks/step_policy.py --scenes {arguments.scenes} --seed {arguments.seed}`: {own['ok'].size} "
                f"random extreme scenes. As they are these numbers leave {own['wrong'].sum()} of the {counted} that end ok "
                f"silently wrong, the largest error is {own['margin'].max():.2g} of its promise, and "
                f"{100 * own['ok'].mean():.1f} % end ok; the others are refused by a result code, and `simulate` runs them again "
                "with steps that adapt. *Wrong*: silently wrong scenes. *Error*: the largest, over the promise. *Steps*: over "
                "those of the library's own policy.",
                "",
                report.table(head, rows),
            ]
        ),
        PAGE,
    )


if __name__ == "__main__":
    main()
