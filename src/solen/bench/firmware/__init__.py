"""Firmware of emitter boards: sources for each board, and the core that runs on the board and on this computer."""
