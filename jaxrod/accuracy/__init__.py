"""How wrong a number is, and what accuracy costs.

- `quantity`: the number.  `reference`: the right one, of the exact rod.
- `error_budget`: the error of a run in parts.  `predictability`: for how long an error stays small.
- `ladder`: the model ladder, a scene with fewer or more strain shapes; its rungs are rigid, quasi-static, elastic.
- `planning` finds the cheapest way to an accuracy, a `run_plan`, by the `fewest_steps` of each and a `cost_model`;
  `work_precision` measures all ways.
"""

from . import ladder as ladder
