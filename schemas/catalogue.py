"""Every module of schemas. The list is part of no key: a schema may move to another module, and modules may become one."""

from __future__ import annotations

from schemas import affordance, benchmark, episodes, files, grasp, hand, interaction, masks, mesh, scene, surface, training, video

MODULES = (affordance, benchmark, episodes, files, grasp, hand, interaction, masks, mesh, scene, surface, training, video)
