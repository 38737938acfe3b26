"""First words of warnings that are left out of a resin file, shared by the code that writes and reads the warnings."""

K_MASKED = "k is masked"
THICKNESS_NOT_IN_K = "the uncertainty of the thickness is not specified"
LAUNCHED = "the launched power is not known"
NOT_STORED = (K_MASKED, THICKNESS_NOT_IN_K, LAUNCHED)
"""First words of warnings about quantities that a resin file does not contain: the extinction coefficient and the
coupling loss.
"""
BY_ORIENTATION = "the loss depends on the build orientation"
"""First words of a warning that does not apply if one orientation is selected."""
