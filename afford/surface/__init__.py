"""From mesh and task to negative and positive affordance on its faces."""
