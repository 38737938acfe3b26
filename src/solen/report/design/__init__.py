"""Figures and pages of a sensor's design."""
