"""Prediction on RGB-D video and pictures of a user."""
