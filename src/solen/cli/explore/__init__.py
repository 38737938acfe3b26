"""Commands that explore designs."""
