"""Training loop shared by all models: steps, checkpoints, resuming, curves, several processes, artifacts."""
