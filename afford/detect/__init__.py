"""Hands in pictures that nobody annotated."""
