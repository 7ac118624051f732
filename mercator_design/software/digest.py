"""A digest of all by which a robot perceives and acts: two computers with the same digest decide alike."""

import hashlib
from importlib.resources import files

from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.software.needed import entries_of

FILES = {
    "modules": ("behaviours", "clustering", "conditions", "flavour", "module", "perception", "reference"),
    "fsm": ("control", "pfsm"),
    "network": ("control", "inputs", "network"),
    "tree": ("control", "tree"),
    "software": ("architectures", "controller"),
}
"""Those of some folders of this package."""


def control_digest(flavour: str = DEFAULT_FLAVOUR) -> str:
    """The digest of files of this package, and of a flavour and plugins that are not shipped, as hexadecimal text.

    It is the same in a checkout and in a bundle, which is a zip file.
    """
    digest = hashlib.sha256()
    for folder, names in FILES.items():
        for name in names:
            digest.update(files("mercator_design").joinpath(folder, f"{name}.py").read_bytes() + b"\0")
    for key, value in entries_of(flavour).items():
        digest.update(f"{key}: {value}\0".encode())
    return digest.hexdigest()[:16]
