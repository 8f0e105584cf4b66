"""Procedural closed meshes of household objects with labelled parts."""
