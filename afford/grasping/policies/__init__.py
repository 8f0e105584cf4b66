"""Policies: residual teacher, scripted expert, student from point clouds, and their training."""
