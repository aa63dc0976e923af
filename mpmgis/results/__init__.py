"""One answer for each question about a flow: runout, profile, hydrograph, comparison, loads."""
