"""Many runs of one scene: what accuracy costs in time."""
