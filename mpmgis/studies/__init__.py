"""Many runs of scenes: ensemble, region, calibration, accuracy against computing time."""
