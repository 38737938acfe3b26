"""The compiled kernel: curves, surfaces and the loop over rays; `solen.trace.engine` drives it."""
