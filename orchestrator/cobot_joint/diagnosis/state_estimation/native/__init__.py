"""Loops over samples in C, and the calls into them."""
