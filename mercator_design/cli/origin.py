"""The origin of a controller, from its header and its run folder."""

import shlex
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mercator_design.command import warn
from mercator_design.config.writing import digest_of
from mercator_design.designer import Designer
from mercator_design.errors import MercatorError, MissionError, excerpt
from mercator_design.plugins.loading import loaded_plugins
from mercator_design.plugins.sources import is_plugin
from mercator_design.results import provenance
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software.needed import MODULES, plugins_in


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """The origin of a controller."""

    file: Path
    header: Mapping[str, str]
    folder: Path  # of its race
    race: Mapping[str, Any]  # the start of its race, from the folder's provenance; empty if there is none

    @property
    def module_plugins(self) -> set[str]:
        """The names of the plugins of which it has modules."""
        return {name for name, _ in plugins_in(self.header.get(MODULES, ""))}

    def plugins(self) -> Iterator[tuple[str, str]]:
        """Names and digests of its plugins at design; a name may come twice."""
        yield from plugins_in(self.header.get("plugins", ""))
        plugins = self.race.get("plugins")
        if isinstance(plugins, Mapping):
            yield from plugins.items()

    def check_loaded(self, of_modules: Container[str] = ()) -> None:
        """Make sure that its plugins are loaded, and have not changed since it was designed.

        Args:
            of_modules: Names of plugins whose digests were compared when its modules were read.

        Raises:
            MissionError: A plugin is not loaded or has changed.
        """
        loaded = loaded_plugins()
        for name, digest in self.plugins():
            if name not in loaded:
                copy = self.folder / "plugins" / name
                is_there = Path(name).name == name and is_plugin(copy)
                advice = f"give --plugin {shlex.quote(str(copy))}" if is_there else "give that plugin with --plugin"
                raise MissionError(f"{self.file}: was designed with the plugin {excerpt(name)}; {advice}, or --mission")
            if loaded[name] != digest and name not in of_modules:
                raise MissionError(f"{self.file}: {self._edited(name)}; give --mission")

    def check_plugin(self, name: str, digest: str, *, refuse: bool) -> None:
        """Refuse a plugin that has changed since the design, or warn of it.

        Raises:
            MissionError: The plugin has changed and is to be refused.
        """
        if all(digest == known for other, known in self.plugins() if other == name):
            return
        if refuse:
            raise MissionError(f"{self.file}: {self._edited(name)}; it was not run; give --mission to use it")
        warn(f"{self.file}: {self._edited(name)}; the present version is used")

    @staticmethod
    def _edited(name: str) -> str:
        return f"{excerpt(name)} has changed since this was designed"

    def has_changed(self, model: RobotModel) -> bool | None:
        """Whether a robot model differs from that at design; None if it is not known."""
        found = digest_of(model)
        digests = [self.header.get("robot model digest"), self.race.get("robot_model_digest")]
        known = [digest for digest in digests if digest is not None]
        if known:
            return any(digest != found for digest in known)
        return None if "mission" in self.header else False


def origin_of(file: Path, header: Mapping[str, str]) -> Origin:
    """The origin of a controller's file with this header."""
    failed = file.parent.name == "failed"
    place = file.parent.parent if failed else file.parent
    race: Mapping[str, Any] = {}
    try:
        if (place / provenance.PROVENANCE).is_file():
            race = provenance.read(place).race
    except MercatorError:  # the folder is damaged; the header can still be used
        pass
    if header.get("mission digest", race.get("mission_digest")) != race.get("mission_digest") or not (
        "mission digest" in header or failed or file.name == Designer.WINNER
    ):
        race = {}  # the controller is of another race
    return Origin(file=file, header=header, folder=place, race=race)
