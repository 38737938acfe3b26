"""The paper's figures as made by solen, and the page that compares their values with the paper's."""
