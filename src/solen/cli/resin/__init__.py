"""Commands of a resin."""
