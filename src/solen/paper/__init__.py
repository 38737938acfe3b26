"""The paper: its statements and their locations, simulated data for its measurements, and the agreement rule."""
