"""Mask tracks of hands and objects: link entities, propagate, find contact."""
