"""Instruments that are not there, behind the same interfaces and on the same wire as those that are."""
