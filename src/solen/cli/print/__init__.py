"""The `solen print` commands."""
