"""Recordings in: files become regular, unit-checked recordings with known noise."""
