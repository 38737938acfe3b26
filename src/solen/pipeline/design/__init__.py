"""Commands for a sensor design."""
