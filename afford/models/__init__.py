"""Adapters to foundation models and their weights: SAM, SAM 2, SAM 3, CLIP, chat models, hub."""
