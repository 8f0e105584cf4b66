"""Policies: teacher over a frozen prior, student from depth cameras, their training and their files."""
