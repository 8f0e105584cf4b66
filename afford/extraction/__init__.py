"""Extraction of two-hand affordance from video: sources, hand detection, tracks, inpainting, completion, intersection."""
