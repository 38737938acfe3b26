"""The commands of `solen project`: sample data, archives, and the figures of the paper."""
