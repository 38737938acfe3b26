"""Firmware of emitter boards: sources that are written for a board, and the core that runs on one and here."""
