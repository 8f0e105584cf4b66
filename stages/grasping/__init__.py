"""Stages from hand motion and bodies to grasps."""
