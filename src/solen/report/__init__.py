"""Every figure, the numbers as plain data, and the HTML report."""
