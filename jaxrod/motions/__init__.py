"""How a rod is held and driven, what pushes it, and where it is.

- `motion`: what holds or drives it.  `state`: where it is and how it moves, free of coordinates.
- `force`: forces without a potential, by their power.  `stiffening`: which of them change the axial frequencies.
- `signal`: recorded or sudden functions of time.  `preview` looks at all such functions before a run, `stops` says where
  its steps end.

A new force is a class with `power` and `check`, a new motion one with the facts that `AbstractMotion` names; each composes with
each rod, basis and solver, or is refused in a sentence.
"""
