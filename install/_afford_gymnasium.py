"""Register afford's environments when gymnasium is imported. A `.pth` file in site-packages imports this module at start-up.

The module imports nothing of afford: an entry point is a name, which gymnasium imports when the environment is created. A script in
another checkout therefore gets that checkout's afford, and a stage that imports gymnasium opens no file outside its key.
"""

import sys

REGISTRY = "gymnasium.envs.registration"
ENVIRONMENTS = {
    "afford/AffordanceGrasp-v0": ("afford.grasping.env.env:AffordanceGrasp", "afford.grasping.env.env:AffordanceGraspVector"),
    "afford/HandImitation-v0": ("afford.grasping.imitation.imitate_env:HandImitation",
                                "afford.grasping.imitation.imitate_env:HandImitationVector"),
}
"""same entries as in afford/environments.py"""


class _Finder:
    """Find gymnasium's registry through the other finders, and append the registration to its loading."""

    def find_spec(self, name, path=None, target=None):
        if name != REGISTRY:
            return None
        sys.meta_path.remove(self)
        spec = next((found for finder in sys.meta_path if (found := finder.find_spec(name, path, target))), None)
        if spec is not None and hasattr(spec.loader, "exec_module"):
            _append(spec.loader)
        return spec


def _append(loader):
    load = loader.exec_module

    def exec_module(module):
        load(module)
        for name, (one, many) in ENVIRONMENTS.items():
            if name not in module.registry:
                module.register(id=name, entry_point=one, vector_entry_point=many)

    loader.exec_module = exec_module


sys.meta_path.insert(0, _Finder())
