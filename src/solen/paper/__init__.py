"""The paper: its statements and their places, simulated data in place of its measurements, and a rule of agreement."""
