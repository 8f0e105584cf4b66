"""Stages that render scenes, objects and interactions with exact ground truth."""
