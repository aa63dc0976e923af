"""Potential release areas of snow slabs in a DTM, and the thickness of the slabs."""
