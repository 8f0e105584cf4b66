"""Reinforcement learning: PPO, DAgger, point-cloud policy."""
