"""What is on no list: formulas and tables at ports, and how they hold against listed terms."""
