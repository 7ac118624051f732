"""Whether two computers decide alike: a digest of the files by which a PFSM perceives and acts."""

import hashlib
from importlib.resources import files

FILES = ("behaviours", "clustering", "conditions", "control", "modules", "perception", "pfsm", "reference")
"""Those of this folder."""


def control_digest() -> str:
    """The digest, as hexadecimal text; the same in a checkout and in a bundle, which is a zip file."""
    digest = hashlib.sha256()
    for name in FILES:
        digest.update(files(__package__).joinpath(f"{name}.py").read_bytes() + b"\0")
    return digest.hexdigest()[:16]
