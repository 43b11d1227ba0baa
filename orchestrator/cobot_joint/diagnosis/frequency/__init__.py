"""Frequency responses: each way to read the experiment is fitted, the best one is the answer."""
