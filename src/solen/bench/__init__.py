"""The bench: instruments, real or simulated, a protocol that moves them, and what they say, on disk as it comes."""
