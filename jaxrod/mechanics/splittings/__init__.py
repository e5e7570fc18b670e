"""The equations of motion of a scene as the solvers of `integrators` step them.

- `uniform_strain`: flat in q = (1 + eps) d, drift and kick.  `multistep`: the same with its positions before.
- `free_rotation`: turning and axial vibration exact, their coupling a small kick.  `driven_rotation`: the vibration of a rod
  that is driven.  Both stand on `normal_modes`.
- `unsplit`: the whole acceleration, for Runge-Kutta methods.
- `common`: what they share; the centre of mass in flight.
"""
