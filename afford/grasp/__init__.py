"""Environments of grasping: what is to be grasped, what is seen and done, what it is worth, and how it went."""
