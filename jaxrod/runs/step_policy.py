"""By which numbers `fixed_steps.step_size` counts equal steps, and `acceptance` believes a run of them.

The numbers alone are here: `fixed_steps.step_size` decides the size of a step.
"""

from typing import Any

import equinox as eqx


class StepPolicy(eqx.Module):
    """The numbers behind the default's steps.  docs/step_policy.md shows what each of them buys.

    Steps, as phases (rad) of what they resolve:

    - `finest`: of the slowest axial mode and the turning together in a step of `BlanesMoan6` at a tolerance of 1e-8;
      `finest_small_kicks`: likewise of `ABA864` where kicks are as strong as the springs.
    - `longest_phase` (the method is stable up to 3.14) and `longest_turn`: the most at any tolerance.
    - `stretched` and `stretched_small_kicks`: by how much a strain of one shortens a step.

    Counts of several strain shapes:

    - `clear`: sine of half a mode's phase in a step, below which the kicks of many steps add up; it is 0 in resonance.

    What a run is asked at its end:

    - `pressed`: the strain below which steps counted from the start are not trusted; `hopeless`: the strain ahead above which
      they are not, by float type.
    - `open_energy`: energy lost, in tolerances, above which steps were too long.
    - `unresolved`: difference from a run of `fewer` as many steps, in tolerances, that is too large, by float type; `at_first`:
      share of it that is too large in the first part of a run.  `fewer` is no half, which is in resonance with the same mode.
    - `hard`: strain ahead above which several shapes are compared so over the whole run; `lingering`: energy, from that of
      standing upside down, within which any run is.
    - `each_radian`: rounding of the tip's place for each radian that the rod turns, over its length, by float type.
    """

    finest: Any = 0.3
    finest_small_kicks: Any = 0.11
    longest_phase: Any = 3.0
    longest_turn: Any = 0.4
    stretched: Any = 0.7
    stretched_small_kicks: Any = 8.0
    clear: Any = 0.3
    pressed: Any = -2 / 3
    hopeless: dict[str, Any] = eqx.field(default_factory=lambda: {"float64": 1e3, "float32": 2.0})
    open_energy: Any = 0.3
    unresolved: dict[str, Any] = eqx.field(default_factory=lambda: {"float64": 1.5, "float32": 1.0})
    at_first: Any = 0.25
    fewer: Any = 0.618
    hard: Any = 0.05
    lingering: Any = 0.2
    each_radian: dict[str, Any] = eqx.field(default_factory=lambda: {"float64": 0.0, "float32": 6e-7})
