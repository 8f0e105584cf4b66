"""Stages from image and task to a region for each hand."""
