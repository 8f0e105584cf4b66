"""Hand landmarks: palm detection and 21 keypoints of a hand, with two TFLite networks of MediaPipe in cv2.dnn."""
