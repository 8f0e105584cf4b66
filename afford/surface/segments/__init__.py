"""Segment a surface into candidate parts."""
