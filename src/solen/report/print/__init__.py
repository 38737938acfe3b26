"""Figures of prints."""
