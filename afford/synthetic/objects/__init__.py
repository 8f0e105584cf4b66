"""Procedural meshes of objects with named parts."""
