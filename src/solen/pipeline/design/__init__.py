"""Commands of a sensor's design."""
