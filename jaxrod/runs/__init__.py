"""One run: what is asked, how it is stepped, what it returns.

- `execution`: a `Request`, its arguments checked by `arguments`, and what runs it; `defaults` choose solver and chart.
- `scales`: how fast a scene moves.  `step_policy`: the numbers by which steps are counted.  `fixed_steps` counts equal
  steps by both, and runs them;
  `acceptance` says whether the run is to be believed.  `adaptive_steps` has Diffrax adapt them.
- `solution`: what a run returns.  `invariants`: what it kept of energy and angular momentum.

Runs any scene of `mechanics`, by any solver of `integrators` or Diffrax.
"""
