"""Recordings checked before anything is fitted: factors, signs, swapped, late, clipped and frozen channels, drift."""
