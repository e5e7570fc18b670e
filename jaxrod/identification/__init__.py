"""Parameters from measurements: `fitting` has `fit`, which finds them and judges what it found, by `least_squares`."""
