"""Figures and pages of a print."""
