"""Which of the proposed effects stay, and how sure that is."""
