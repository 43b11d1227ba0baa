"""Recordings against simulation: where they differ, what physics is missing, and the system repaired."""
