"""Files of other codes: readers of particles, writers of start files."""
