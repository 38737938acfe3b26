"""Commands of the bench and its recordings."""
