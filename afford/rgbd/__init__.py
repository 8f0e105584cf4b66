"""From RGB-D interaction to affordance of the last frame (SOR3D-AFF)."""
