"""Commands of a print."""
