"""State estimation: what a system's states and the forces that no model explains were, along a recorded run."""
