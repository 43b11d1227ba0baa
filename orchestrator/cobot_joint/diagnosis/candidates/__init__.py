"""Families of effects that could be missing: each proposes, none decides."""
