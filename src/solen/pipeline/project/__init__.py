"""Commands for entire projects."""
