"""The bench: real or simulated instruments, the protocol that moves them, and recordings written as the data arrive."""
