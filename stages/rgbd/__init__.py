"""Stages from RGB-D interactions to affordances of the last frame."""
