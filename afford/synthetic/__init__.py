"""Worlds with exact ground truth, written in the published formats."""
