"""What happens before and between the steps of a run: preparation, stages, warm-up, cost."""
