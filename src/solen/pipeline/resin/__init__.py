"""What the commands do of a resin."""
