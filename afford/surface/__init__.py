"""Surface system: from mesh and task to negative and positive affordance on the faces of the mesh."""
