"""Measures, one formula per function, with the rule for empty inputs written down."""
