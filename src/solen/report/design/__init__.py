"""Figures and pages for a sensor design."""
