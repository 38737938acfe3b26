"""Figures and pages for bench measurements and recordings."""
