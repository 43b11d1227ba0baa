"""What to record next, so that indistinguishable effects can be told apart."""
