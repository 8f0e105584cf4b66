"""SOR3D-AFF as a whole: what is trained, how right it is, and the report of that."""
