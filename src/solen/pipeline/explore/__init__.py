"""Commands that explore designs: sweeps, optimisation and tolerances."""
