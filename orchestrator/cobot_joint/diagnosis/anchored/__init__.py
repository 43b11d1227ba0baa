"""Machines that no model fits to the noise: terms judged along the recorded motion, beside a background."""
