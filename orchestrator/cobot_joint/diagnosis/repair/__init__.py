"""Findings become FMUs and systems, which are held against recordings that they have not seen."""
