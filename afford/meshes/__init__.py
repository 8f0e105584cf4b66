"""Meshes from outside: reading, checking, repairing, one texture for all of it, and a texture where there is none."""
