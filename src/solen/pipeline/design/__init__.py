"""What the commands do of a sensor's design."""
