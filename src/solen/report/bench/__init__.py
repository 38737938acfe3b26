"""Figures and pages of the bench and its recordings."""
