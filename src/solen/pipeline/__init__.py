"""Implementation of the commands: they read inputs, call stages and write outputs.

Every function returns an `Outcome`; the command line only chooses how to show it. Everything is
computed before the first file is written, and files are renamed into place, so that an interrupted command
leaves nothing half-written. One module per part of the chain; nothing is imported here, so that a command loads no more
than it needs.
"""
