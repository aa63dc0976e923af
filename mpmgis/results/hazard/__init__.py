"""Hazard maps: intensity guidelines, hazard levels, scenarios, the printed map."""
