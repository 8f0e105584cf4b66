"""Hand landmarks: palm detection and 21 keypoints of a hand, with two published networks of MediaPipe."""
