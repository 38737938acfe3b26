"""The statements of the paper, the rule that compares them with solen, and simulated data for its measurements."""
