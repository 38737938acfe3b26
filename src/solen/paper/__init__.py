"""The paper: what it states and where, data simulated in place of its measurements, agreement by a stated rule."""
