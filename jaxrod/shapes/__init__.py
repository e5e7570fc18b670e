"""The strain of a rod as a sum of n shapes, so that a few small arrays stand for the rod.

Where its points are, and what the energies need of that:

    x(s, t) = phi_0(s) + sum_k a_k(t) phi_k(s),    M_kl = int rho A phi_k phi_l ds,    K_kl = int E A phi_k' phi_l' ds

`basis` holds the polynomials `Ritz`, `ForceRitz` and `QuasiStatic`, whose strain follows without inertia; `load_basis` the shapes
of loads, `LoadRitz`; each makes a `projection`, which is all that `mechanics` sees of a rod.

A new basis is a class with `n`, `uniform` and `strains`; it composes with every motion, chart, splitting and solver.
"""
