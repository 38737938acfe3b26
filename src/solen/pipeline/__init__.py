"""Implementation of the commands: they read inputs, call stages and write outputs.

Every function returns an `Outcome`; the command line only chooses how to show it. Everything is computed before the
first file is written, and files are renamed into place, so an interrupted command leaves no incomplete file. There is
one module for each command or group of commands; this package imports none of them, so a command loads no more than it
needs.
"""
