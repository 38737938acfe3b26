"""Firmware of emitter boards: sources for each board, and a core that runs on the board and on the computer."""
