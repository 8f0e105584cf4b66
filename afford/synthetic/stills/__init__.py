"""Rendered still images of objects and hands on a table, with exact labels."""
