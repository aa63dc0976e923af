"""Files of other codes: readers of results, writers of start files."""
