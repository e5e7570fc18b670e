"""Parameters from measurements: `fitting` finds them and judges what it found, by `least_squares`."""
