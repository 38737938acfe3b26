"""Simulated instruments, behind the same interfaces as real ones."""
