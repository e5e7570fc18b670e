"""The strain of a rod as a sum of n shapes: what makes of a rod a few small arrays.

    x(s, t) = phi_0(s) + sum_k a_k(t) phi_k(s),    M_kl = int rho A phi_k phi_l ds,    K_kl = int E A phi_k' phi_l' ds

`basis` holds the polynomials `Ritz`, `ForceRitz` and the rung without inertia, `QuasiStatic`; `load_basis` the shapes of
loads, `LoadRitz`; each makes a `projection`, which is all that `mechanics` sees of a rod.

A new basis is a class with `shapes` and `strains`; it composes with every motion, chart, splitting and solver.
"""
