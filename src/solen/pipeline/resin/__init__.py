"""The `solen resin` commands."""
