"""Objects seen from all sides: where cameras stand, what each sees of the surface, and the pictures."""
