"""How a run ended: one code per scene, a sentence each."""

import enum
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Int8

from . import tracing


class _Sentences(enum.EnumMeta):
    """An enumeration whose `[code]` is the sentence of a code, or of each in an array of them."""

    def __getitem__(cls: Any, code: Any) -> Any:
        if isinstance(code, str):
            return super().__getitem__(code)
        if not tracing.known(code):
            raise ValueError("Result[code] is a sentence of a known code; ask outside of transformations.")
        codes = np.asarray(code)
        if codes.dtype.kind not in "iu" or not np.all(np.isin(codes, list(cls))):
            raise ValueError(f"Result[{code!r}] is no code; give one from 0 to {len(cls) - 1}, such as sol.result.")
        return cls(int(codes)).sentence if codes.ndim == 0 else [cls[each] for each in codes]


class Result(enum.IntEnum, metaclass=_Sentences):
    """Result codes, one per scene: small integers (int8), which travel through `jit` and `vmap` and which NumPy keeps.

    Compare with `sol.result == jaxrod.Result.ok`; `jaxrod.Result[sol.result]` gives the sentence, of an array of codes a
    list of them, and `jaxrod.Result(3).name` the name.

    >>> import jaxrod
    >>> print(jaxrod.Result.collapsed.name, int(jaxrod.Result.collapsed), jaxrod.Result[0])
    collapsed 1 the run reached its end
    """

    sentence: str

    def __new__(cls, sentence: str):
        member = int.__new__(cls, len(cls.__members__))
        member._value_, member.sentence = int(member), sentence
        return member

    @staticmethod
    def where(condition: Bool[ArrayLike, "*scenes"], then: Any, otherwise: Any) -> Int8[Array, "*scenes"]:
        """One code where a condition holds, another elsewhere."""
        return jnp.where(condition, then, otherwise).astype(jnp.int8)

    @staticmethod
    def first(*cases: tuple[Bool[ArrayLike, "*scenes"], Any]) -> Int8[Array, "*scenes"]:
        """The code of the first case whose condition holds; `ok` if none does."""
        code: Any = Result.ok
        for condition, why in reversed(cases):
            code = Result.where(condition, why, code)
        return code

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
        "below -1, an inertia beyond what their type holds: float32 ends at 1e-38), or functions along the rod are not "
        "resolved: name the places where they jump by breaks="
    )
    unseen = (
        "a function of time is zero at each of the 4,097 instants at which a run looks at it, or moves something without "
        "accelerating it, as a jump and straight pieces do; if it is meant to be more than that give a short load as "
        "jaxrod.Impulse, samples as jaxrod.Record"
    )


class SimulationError(RuntimeError):
    """A run did not reach its end.  `solution` holds all that was computed until then."""

    def __init__(self, message: str, solution: Any):
        super().__init__(message)
        self.solution = solution
