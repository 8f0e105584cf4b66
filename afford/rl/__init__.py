"""Reinforcement learning: policies and PPO. Knows no hands and no objects."""
