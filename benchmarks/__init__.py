"""Benchmarks: ratios measured in one run on one machine, against monolithic loops and other co-simulation masters."""
