"""Evaluation of policies: episodes, metrics, human-likeness, reports, pictures."""
