"""What a rod is: length, section, material, law, and bodies at its tip.

    mass rho A per length,  stiffness E A,  both functions of the material coordinate s in 0 .. length

`rod` puts a `section` (area along s) and a `law` (stress of a strain) together; `lumped` is a body of four numbers in place
of it.  `looking` finds where functions of s jump or bend, `resolution` the panels whose `quadrature` integrates them;
`plausibility` asks about numbers that no rod has in SI.

Composes with each basis of `shapes` and motion of `motions`, or is refused in a sentence; the exact rod (`continuum`) reads the
same `Rod`.
"""

from . import law as law
