"""Read, repair, texture and label meshes."""
