"""Files of other codes: readers of their results, writers of their start files."""
