"""Lagrange's equations of a rod in motion.

    d/dt (dL/dv) - dL/dq = Q,    L = T - V

The physics is in three files: `energy` (T and V of a state), `equations` (L = T - V of a rod) and `chart` (its coordinates).
`lagrangian` makes accelerations of any L by automatic differentiation, and knows no rods.

`system` is the scene that users build, checked by `compatibility`, started by `initial_state`; `equilibria` finds where it
rests, `vibration` how it vibrates about there.  `splittings` are the equations of a scene as the solvers of `integrators` step
them.

A rod, a basis, a motion and forces compose, or `compatibility` refuses them in a sentence.  `system` refuses a chart or a
splitting that a scene does not have.
"""

from . import energy as energy
