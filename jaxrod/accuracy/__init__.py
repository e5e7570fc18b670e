"""How wrong a number is, and what accuracy costs.

- `quantity`: which number of a run.  `reference`: the right one, by the exact rod.
- `error_budget`: the error of a run in parts.  `predictability`: for how long an error stays small.
- `ladder`: the model ladder, a scene with fewer or more strain shapes; its rungs are rigid, quasi-static, elastic.
- `planning` has `plan`, which finds the cheapest way to an accuracy, a `run_plan`, by the `fewest_steps` of each and a
  `cost_model`.  `work_precision` has `tradeoff`, which runs a scene in many ways and measures error and cost of each.

A quantity is any function of a solution.  It composes with each scene of `mechanics`, or is refused in a sentence: `plan` and
`tradeoff` want known numbers and float64, `tradeoff` a `Rod`.  The exact rod is the truth where it takes the scene, else richer
rungs are.
"""

from . import ladder as ladder
