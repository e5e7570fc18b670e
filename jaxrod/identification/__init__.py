"""Parameters from measurements: `fitting` has `fit`, which finds them and judges what it found, by `least_squares`.

Composes with any function of parameters that JAX differentiates: frequencies, modes and runs of a scene or of the exact rod.  The
search may be any least-squares solver or minimiser of Optimistix, or an optimiser of Optax.
"""
