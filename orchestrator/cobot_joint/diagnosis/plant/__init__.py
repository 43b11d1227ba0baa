"""A system that can be simulated beside a recording: parameters, switched-off terms and additive ports, from FMUs."""
