"""Figures of explored designs."""
