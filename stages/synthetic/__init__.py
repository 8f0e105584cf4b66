"""Stages that render worlds with exact ground truth."""
