"""Grasping environments: task, observation, action, reward, metrics."""
