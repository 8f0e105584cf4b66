"""Surfaces cut into regions that may be parts: features of faces, a tree of merges, and the regions that stand out in it."""
