"""Whether two computers decide alike: a digest of the files by which control software perceives and acts."""

import hashlib
from importlib.resources import files

FILES = {
    "modules": ("behaviours", "clustering", "conditions", "flavour", "module", "perception", "reference"),
    "fsm": ("control", "pfsm"),
    "network": ("control", "inputs", "network"),
    "tree": ("control", "tree"),
    "software": ("architectures", "controller"),
}
"""Those of some folders of this package."""


def control_digest() -> str:
    """The digest, as hexadecimal text; the same in a checkout and in a bundle, which is a zip file."""
    digest = hashlib.sha256()
    for folder, names in FILES.items():
        for name in names:
            digest.update(files("mercator_design").joinpath(folder, f"{name}.py").read_bytes() + b"\0")
    return digest.hexdigest()[:16]
