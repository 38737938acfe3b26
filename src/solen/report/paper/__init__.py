"""The figures of the paper as reproduced by solen, and the page that compares their values with those of the paper."""
