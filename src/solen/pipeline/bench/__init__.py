"""What the commands do of the bench and its recordings."""
