"""Cell sums, map quantities, runout, comparison and balances of a result."""
