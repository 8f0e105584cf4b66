"""Training: one loop that knows no task, batches that are a function of a seed and a number, and what a training leaves."""
