"""Many runs of one scene: accuracy against run time, and ensembles of sampled scenes."""
