"""One run: what is asked, how it is stepped, what it returns.

- `execution`: a `Request`, its arguments checked by `arguments`, and what runs it; `defaults` choose solver and chart.
- `fixed_steps` counts equal steps by `scales`, how fast a scene moves, and by the numbers of `step_policy`; then it runs them.
- `acceptance` says whether such a run is to be believed.
- `adaptive_steps` has Diffrax adapt the steps.
- `solution`: what a run returns.  `invariants`: what it kept of energy and angular momentum.

Runs each scene of `mechanics` by each solver of `integrators` or Diffrax, or refuses it in a sentence.
"""
