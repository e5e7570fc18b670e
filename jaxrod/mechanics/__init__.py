"""Lagrange's equations of a rod in motion.

    d/dt (dL/dv) - dL/dq = Q,    L = T - V

`energy` and `chart` are the formulas: T and V of a state, q and v of a state.  `lagrangian` makes accelerations of any L
by automatic differentiation, `equations` those of a scene in a chart; `system` is the scene that users build, checked by
`compatibility`, started by `initial_state`.  `equilibria` finds where it rests, `vibration` how it vibrates about there.
`splittings` cut its equations into flows that are known exactly, for the solvers of `integrators`.

Any rod, basis, motion and forces compose; a chart or splitting that a scene does not have is refused by name.
"""

from . import energy as energy
