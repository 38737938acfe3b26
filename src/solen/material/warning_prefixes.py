"""First words of warnings that a resin file does not repeat, shared by the code that writes and reads them."""

K_MASKED = "k is masked"
THICKNESS_NOT_IN_K = "the uncertainty of the thickness is not specified"
LAUNCHED = "the launched power is not known"
NOT_STORED = (K_MASKED, THICKNESS_NOT_IN_K, LAUNCHED)
"""First words of warnings about quantities that a resin does not store: the extinction coefficient and the coupling
loss.
"""
BY_ORIENTATION = "the loss depends on the build orientation"
"""First words of a warning that no longer applies once an orientation is chosen."""
