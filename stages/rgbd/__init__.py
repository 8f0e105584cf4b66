"""Stages from RGB-D interaction to affordance of the last frame."""
