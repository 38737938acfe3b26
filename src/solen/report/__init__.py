"""Figures, values as plain data, and the HTML report."""
