"""First versions for a machine of your own: a system from a chain of parts, a campaign from a log."""
