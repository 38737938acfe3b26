"""The paper's figures from a run of solen, and the page that compares them with the paper's values."""
