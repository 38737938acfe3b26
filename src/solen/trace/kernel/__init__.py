"""The compiled kernel: curves, surfaces and the loop over rays, called by `solen.trace.engine`."""
