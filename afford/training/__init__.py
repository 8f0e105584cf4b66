"""One training loop: steps, checkpoints, resuming, curves, several processes, written files."""
