"""Negative affordances on the surface: votes of views on faces, points, distances, and files for people."""
