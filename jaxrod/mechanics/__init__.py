"""Lagrange's equations of a rod in motion.

    d/dt (dL/dv) - dL/dq = Q,    L = T - V

The physics is `energy` (T and V of a state), `chart` (q and v of a state) and `equations` (a scene in a chart); `lagrangian`
makes accelerations of any L by automatic differentiation.  `system` is the scene that users build, checked by `compatibility`,
started by `initial_state`; `equilibria` finds where it rests, `vibration` how it vibrates about there.  `splittings` are the
equations of a scene as the solvers of `integrators` step them.

Any rod, basis, motion and forces compose; a chart or splitting that a scene does not have is refused by name.
"""

from . import energy as energy
