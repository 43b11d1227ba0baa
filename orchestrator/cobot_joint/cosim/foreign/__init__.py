"""Units that others built: the step at which they couple, and what they can and lack."""
