"""Register afford's environments when gymnasium is imported. Lies in site-packages; a `.pth` file imports it when Python starts.

It imports nothing of afford before gymnasium is there, so that a script in another checkout still gets that checkout's afford.
"""

import sys

REGISTRY = "gymnasium.envs.registration"


class _Finder:
    """Finds gymnasium's registry as the other finders do, and appends the registration to its loading."""

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
        try:
            from afford.environments import register
        except ImportError as error:  # the checkout is gone, or a folder of the user's hides it; gymnasium works all the same
            sys.stderr.write(f"afford's environments are not registered with gymnasium: {error}\n")
        else:
            register(module)

    loader.exec_module = exec_module


sys.meta_path.insert(0, _Finder())
