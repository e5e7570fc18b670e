"""Methods that step equations of motion; they know no rods.

How a run by equal steps is made, from the outside in:

- `fixed_step.march` goes from save time to save time: opens a phase, takes so many steps, closes it, saves it.  Two ways from
  one start, a run and its comparison with fewer steps, are two passes of one loop.
- A *stepped scene* (`splitting.AbstractStepper`) turns a state into a phase and back, and takes a step.  One that is cut into
  flows (`AbstractSplitting`) says what a stage does, and undoes one; its steps are scans over the stages of a scheme.
- A *scheme* is a list of coefficients: `symplectic`, compositions of drift and kick; `multistep`, one force a step, as they keep
  the positions of steps before; `runge_kutta`, for forces that depend on rates.
- All arrays within the loop have the lanes, scenes side by side, as their last axis (`core.lanes`): under `vmap` scenes become
  lanes.  What is alike in all lanes, as the step where it is given, is held once.
- The *adjoint*: the reverse derivative undoes stage by stage from each saved state, and takes the derivative of the stage where
  it began; it asks for those by times and by the rod only where they are wanted.  Forward derivatives
  (`adjoint=diffrax.ForwardMode()`) go through the loop.  `reversal` refuses others in a sentence.

Steps that adapt, and whatever else Diffrax does (events, `SaveAt`, meters), go through `diffrax.diffeqsolve`: `symplectic`
solvers are Diffrax's too, and `compensation` is one that keeps full turns and the digits that rounding cuts off.
`event_time` finds when an event happens.

A new splitting method is a list of coefficients in `symplectic`; it composes with each splitting of `mechanics`, or `runs`
refuses it in a sentence.
"""
