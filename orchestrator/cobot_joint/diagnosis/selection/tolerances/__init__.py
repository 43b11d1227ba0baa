"""Base parameters outside their tolerances: found, held against listed terms, and told from one another."""
