"""What the commands do of a print."""
