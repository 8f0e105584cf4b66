"""Physics worlds of one hand and one object: MuJoCo, PyBullet and Warp."""
