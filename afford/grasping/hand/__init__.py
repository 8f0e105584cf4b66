"""The robot hand: description files, joints, coupling, kinematics."""
