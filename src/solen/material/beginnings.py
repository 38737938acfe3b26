"""Beginnings of warnings that a resin leaves out, shared by those who write them and by who reads result files."""

K_MASKED = "k is masked"
THICKNESS_NOT_IN_K = "the uncertainty of the thickness is not stated"
LAUNCHED = "what was launched is not known"
NOT_KEPT = (K_MASKED, THICKNESS_NOT_IN_K, LAUNCHED)
"""They are about what a resin does not keep: the extinction coefficient, the coupling loss."""
BY_ORIENTATION = "the loss depends on the build orientation"
"""Settled where an orientation is chosen."""
