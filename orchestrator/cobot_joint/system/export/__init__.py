"""What an exported FMU can become: one with binaries for more platforms, one of FMI 3.0."""
