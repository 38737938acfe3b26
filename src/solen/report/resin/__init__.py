"""Figures and pages of a resin."""
