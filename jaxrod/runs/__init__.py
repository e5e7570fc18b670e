"""One run: what is asked, how it is stepped, what it returns.

- `execution`: a `Request`, its arguments checked by `arguments`, and what runs it; `defaults` choose solver and chart.
- `scales`: how fast a scene moves.  `fixed_steps` counts equal steps by them and by a `step_policy`, and runs them;
  `acceptance` says whether the run is to be believed.  `adaptive_steps` has Diffrax adapt them.
- `solution`: what a run returns.  `invariants`: the books of what it kept.

Runs any scene of `mechanics`, by any solver of `integrators` or Diffrax.
"""
