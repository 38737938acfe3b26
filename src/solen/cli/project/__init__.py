"""Commands of whole projects: `solen project`."""
