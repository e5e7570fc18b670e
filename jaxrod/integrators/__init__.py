"""Methods that step equations of motion; they know no rods.

- `splitting`: what equal steps ask of the equations.  `symplectic`: compositions of drift and kick.  `multistep`: one force a
  step, as they keep the positions of steps before.  `runge_kutta`: for forces that depend on rates.
- `fixed_step`: the one loop of all of them, forwards and, for derivatives, backwards.
- `compensation`: a Diffrax solver that keeps full turns and the digits that rounding cuts off.  `reversal`: derivatives
  that a loop does not have, refused in a sentence.

A new splitting method is a list of coefficients in `symplectic`; it composes with each splitting of `mechanics`, or `runs`
refuses it in a sentence.
"""
