"""The strain of a rod as a sum of n shapes, so that a few small arrays stand for the rod.

Where its points are, and what the energies need of that:

    x(s, t) = phi_0(s) + sum_k a_k(t) phi_k(s),    M_kl = int rho A phi_k phi_l ds,    K_kl = int E A phi_k' phi_l' ds

`basis` holds `Ritz`, polynomials of the strain; `ForceRitz`, polynomials of the force; and `QuasiStatic`, by which the strain of
another basis follows without inertia.  `load_basis` holds `LoadRitz`, the shapes of loads.  Each makes a `projection` of
the rod, which is all that the energies of `mechanics` need.  For `accuracy`, which runs many rungs, `padding` puts several of
a family into arrays of one size, and `projected` keeps what a basis makes of one rod.

A new basis is a class with `n`, `uniform` and `strains`.  It composes with each rod, motion, chart, splitting and solver, or is
refused in a sentence: by its own `misfit` to a rod, and by `mechanics` and `runs`.
"""
