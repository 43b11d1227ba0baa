"""What explains the recordings, of all that was found, and how it is said."""
