"""The equations of motion of a scene as the solvers of `integrators` step them.

- `uniform_strain` (`UniformStrainSplitting`): flat in q = (1 + eps) d, drift and kick.  `multistep` (`MultistepStepper`): the
  same with its positions before.
- `free_rotation` (`FreeRotationSplitting`): turning and axial vibration exact, their coupling a small kick.
  `driven_rotation` (`DrivenRotationSplitting`): the vibration of a rod that is driven.  Both stand on `normal_modes`
  (`AxialModes`).
- `unsplit` (`UnsplitStepper`): the whole acceleration, for Runge-Kutta methods.
- `common`: what they share; the centre of mass in flight (`Center`).

`sol.method` names the solver, and beside it the class that was stepped, or else the chart.
"""
