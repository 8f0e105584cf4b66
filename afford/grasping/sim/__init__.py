"""Physics: MuJoCo, PyBullet and Warp worlds of one hand and one body."""
