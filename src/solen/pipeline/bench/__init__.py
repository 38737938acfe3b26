"""Commands for the bench and its recordings."""
