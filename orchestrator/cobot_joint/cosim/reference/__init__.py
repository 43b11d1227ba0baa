"""The master in plain FMPy: to be read, and to hold the one in C against. Same operations, same bits."""
