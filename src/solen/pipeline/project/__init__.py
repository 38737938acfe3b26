"""Commands of whole projects."""
