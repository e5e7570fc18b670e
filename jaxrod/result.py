"""How a run ended: one code per scene, a sentence each."""

from typing import Any

import equinox as eqx


class Result(eqx.Enumeration):
    """Result codes, one per scene; they travel through `jit` and `vmap`.

    Compare with `sol.result == jaxrod.Result.ok`; `jaxrod.Result[sol.result]` gives the sentence.
    """

    ok = "the run reached its end"
    collapsed = "the rod was pressed together to nothing: a strain reached -1, where the model ends"
    diverged = (
        "the motion grew beyond every bound, or its time scale shrank to nothing; with a fixed step, take a smaller one"
    )
    max_steps = "the run stopped at max_steps before its end; raise max_steps, loosen the tolerance or shorten the run"
    coarse = (
        "steps are too long for the motion: one is beyond the stability of the method, turned the rod by more than half a "
        "right angle, or lost its energy; take more n_steps=, or solver=diffrax.Dopri8(), which adapts them"
    )
    non_finite = "the numbers stopped being finite; with a fixed step, take a smaller one"
    past_critical = (
        "the rod turned faster than any static strain can hold: beyond its critical rate there is no QuasiStatic motion; "
        "take its basis with inertia, such as Ritz(3)"
    )
    invalid = (
        "rod, start or times hold numbers that make no sense (not positive, not finite, unsorted, a strain at or "
        "below -1, or an inertia beyond what their type holds: float32 ends at 1e-38)"
    )


class SimulationError(RuntimeError):
    """A run did not reach its end.  `solution` holds all that was computed until then."""

    def __init__(self, message: str, solution: Any):
        super().__init__(message)
        self.solution = solution
