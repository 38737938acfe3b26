"""What recordings of a sensor mean."""
