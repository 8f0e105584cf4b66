"""Grasping: from hand motion, bodies and negative affordance to prior, teacher, student and 6-DoF grasps."""
