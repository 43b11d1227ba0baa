"""Where recordings and simulation differ: by component, operating condition and time."""
