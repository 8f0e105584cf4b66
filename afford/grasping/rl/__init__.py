"""Reinforcement and imitation learning algorithms: PPO, DAgger, the point-cloud policy, policies as files."""
