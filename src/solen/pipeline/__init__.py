"""The commands, from end to end: they read inputs, call stages and write outputs.

Every function returns an `Outcome`; the command line only chooses how to show it. Whatever is
computed is computed before the first file is written, and files are renamed into place, so that an interrupted command
leaves nothing half-written. One module per part of the chain; nothing is imported here, so that a command loads no more
than it needs.
"""
