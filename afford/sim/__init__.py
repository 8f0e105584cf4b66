"""Physics. Only `bullet.py` imports pybullet."""
