"""Verbs and taxonomy of frames from narrations."""
