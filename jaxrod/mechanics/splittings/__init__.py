"""The equations of motion of a scene as the solvers of `integrators` step them.

- `uniform_strain` (`Flat`): flat in q = (1 + eps) d, drift and kick.  `multistep` (`Remembered`): the same with its
  positions before.
- `free_rotation` (`Axial`): turning and axial vibration exact, their coupling a small kick.  `driven_rotation`
  (`Prescribed`): the vibration of a rod that is driven.  Both stand on `normal_modes` (`AxialModes`).
- `unsplit` (`Whole`): the whole acceleration, for Runge-Kutta methods.
- `common`: what they share; the centre of mass in flight (`Center`).

`sol.method` names the solver, and beside it the class that was stepped, or else the chart.
"""
