"""Synthetic scenes, objects and interactions with exact ground truth, written in the published file formats."""
