"""Evaluation of grasping policies: episodes, metrics, human likeness, reports."""
