"""Exploring designs: sweeps over their numbers."""
