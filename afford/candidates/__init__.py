"""From regions in a picture with depth to grasps: a cloud, what it lies on, poses, their scores."""
