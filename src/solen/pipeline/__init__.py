"""What each command does from end to end: inputs read, stages called, outputs written.

Every function returns a plain dictionary, ready for JSON; the command line only chooses how to show it. Whatever is
computed is computed before the first file is written, and files are renamed into place, so that an interrupted command
leaves nothing half-written. One module per part of the chain; nothing is imported here, so that a command loads no more
than it needs.
"""
