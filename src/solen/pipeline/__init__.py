"""Implementation of the commands, which read inputs, call stages and write outputs.

Every function returns an `Outcome`; the command line only determines how it is shown. Everything is computed before the
first file is written, and files are renamed into place, so an interrupted command leaves no incomplete file. There is
one module for each command or group of commands; this package imports none of them, so that a command loads only what
it needs.
"""
