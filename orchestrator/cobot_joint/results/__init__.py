"""Results of runs: signals in memory and in files, with units and provenance, and pictures of them."""
