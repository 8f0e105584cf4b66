"""Evaluation on RGB-D interactions and single pictures: metrics, reports, pictures."""
