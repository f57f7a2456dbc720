"""Names of the package: no function hides the module of the same name, no folder is crowded."""

import importlib
import pathlib
import pkgutil
import types

import jaxsim

MAX_FILES = 20


def test_no_name_hides_a_module():
    hidden = []
    for module in pkgutil.walk_packages(jaxsim.__path__, "jaxsim."):
        package, _, name = module.name.rpartition(".")
        if name == "__main__":
            continue
        importlib.import_module(module.name)
        if not isinstance(getattr(importlib.import_module(package), name), types.ModuleType):
            hidden.append(module.name)
    assert not hidden


def test_no_folder_has_too_many_files():
    root = pathlib.Path(jaxsim.__file__).parent
    folders = [root, *(f for f in root.rglob("*") if f.is_dir())]
    sizes = {str(f.relative_to(root)): len(list(f.glob("*.py"))) for f in folders}
    assert not {name: size for name, size in sizes.items() if size > MAX_FILES + 1}
