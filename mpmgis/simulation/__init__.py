"""One scene: prepared, run by stages, stopped and restarted; prediction of time and memory."""
