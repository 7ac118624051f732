"""Records: a JSON file in a folder of its own for each, with text files beside it."""

import json
import re
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from mercator_design.config.json_data import read_json
from mercator_design.config.writing import plain
from mercator_design.errors import printable
from mercator_design.serve.settings import ServiceError
from mercator_design.system.files import Unreadable, read_small, sync_folder, write_text

_ALPHABET = "23456789abcdefghjkmnpqrstuvwxyz"  # no characters that look alike
_MAX_SIZE = 4 * 1024 * 1024  # bytes of a text


class StoredRecord(Protocol):
    """A dataclass with an id, which is the name of its folder."""

    @property
    def id(self) -> str:
        """Its id."""


R = TypeVar("R", bound=StoredRecord)


class Records(Generic[R]):
    """The records in a folder.

    Args:
        folder: Folder of the records; made if missing.
        kind: The dataclass.
        file: The name of the file of a record in its folder.

    Raises:
        OSError: The folder cannot be made.
    """

    def __init__(self, folder: Path, kind: type[R], file: str) -> None:
        self._folder, self._kind, self._file = folder, kind, file
        folder.mkdir(parents=True, exist_ok=True)

    def folder(self, identity: str) -> Path:
        return self._folder / identity

    def file(self, identity: str) -> Path:
        return self.folder(identity) / self._file

    def ids(self) -> list[str]:
        return sorted(file.parent.name for file in self._folder.glob(f"*/{self._file}"))

    def add(self, record: R, texts: Mapping[str, str]) -> None:
        """Write a new record with its texts, by their paths in its folder. If one cannot be written, nothing is left.

        Raises:
            ServiceError: A value of the record is not valid.
            OSError: It cannot be written.
        """
        folder = self.folder(record.id)
        folder.mkdir()
        try:
            for name, text in texts.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                write_text(folder / name, text)
            self.write(record)
            self.read(record.id)
            sync_folder(self._folder)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def read(self, identity: str) -> R:
        """A record.

        Raises:
            ServiceError: Its file is missing or damaged.
        """
        file = self.file(identity)
        record: R = read_json(file, self._kind, error=ServiceError)
        if record.id != identity:
            raise ServiceError(f"{file}: id: expected {identity}, as its folder, found {printable(record.id)}")
        return record

    def write(self, record: R) -> None:
        """Write an existing record.

        Raises:
            OSError: It cannot be written; it is as before.
        """
        write_text(self.file(record.id), json.dumps(plain(record), indent=1) + "\n")

    def text(self, identity: str, name: str) -> str:
        """A text of a record.

        Raises:
            ServiceError: It is missing or damaged.
        """
        file = self.folder(identity) / name
        try:
            return read_small(file, _MAX_SIZE).decode()
        except (Unreadable, UnicodeDecodeError) as error:
            raise ServiceError(f"{file}: {error}") from None


def new_id(name: str) -> str:
    """Unique id that begins with a name."""
    stem = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40] or "mission"
    return f"{stem}-{''.join(secrets.choice(_ALPHABET) for _ in range(10))}"
