"""Figures and pages for a print."""
