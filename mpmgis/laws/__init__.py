"""Laws of friction, materials, contact and erosion: formula, unit, source; the table of quantities."""
