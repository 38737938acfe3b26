"""The paper's figures from a run of solen, and the page that sets them beside what the paper states."""
