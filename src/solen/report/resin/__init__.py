"""Figures and pages for a resin."""
