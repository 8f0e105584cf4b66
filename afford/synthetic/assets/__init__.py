"""Graspable scene objects of kitchen, workshop and desk, with materials, joints and grips."""
