"""Prediction on pictures of a user."""
