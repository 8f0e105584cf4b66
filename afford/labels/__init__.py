"""Narrations -> labels of frames."""
