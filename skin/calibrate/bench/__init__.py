"""From the recordings of a bench, clocks and columns as they are, to calibration files."""
