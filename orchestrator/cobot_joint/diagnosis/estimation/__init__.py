"""Whitened residuals, Jacobians, bounded least squares and their marginals. No policy, no prose."""
