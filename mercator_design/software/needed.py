"""Needs of control software that are not shipped: its flavour's file, and the plugins that define its modules.

The header of a file names them with their digests. Another version is refused: it would mean something else.
"""

import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from mercator_design.config.writing import digest_of, dump
from mercator_design.errors import FsmError, excerpt
from mercator_design.modules.flavour import Flavour, flavour_names, flavour_of, load_flavour
from mercator_design.plugins.loading import load_plugin, loaded_plugins, plugin_of
from mercator_design.plugins.sources import Plugin, is_plugin

FLAVOUR_FILE, PLUGINS = "flavour.yaml", "plugins"
"""The file of a flavour and the folder of plugins beside an fsm.txt: in a run folder, and on a robot."""
DIGEST, MODULES = "flavour digest", "module plugins"
NEEDED = {DIGEST, MODULES}
"""Keys of the header."""


def module_plugins(flavour: Flavour) -> tuple[Plugin, ...]:
    """The plugins that define modules of a flavour."""
    found = (plugin_of(module.function) for module in flavour.modules)
    return tuple({plugin.name: plugin for plugin in found if plugin is not None}.values())


def needed_files(flavour: Flavour) -> dict[str, bytes]:
    """The files that a flavour needs and that are not shipped, by their paths beside an fsm.txt."""
    own = {} if flavour.is_shipped else {FLAVOUR_FILE: dump(flavour).encode()}
    modules = {path: data for plugin in module_plugins(flavour) for path, data in plugin.files.items()}
    return own | {f"{PLUGINS}/{path}": data for path, data in modules.items()}


def entries_of(name: str) -> dict[str, str]:
    """The header's entries on what a flavour needs; none if all is shipped."""
    flavour = flavour_of(name)
    found = {} if flavour.is_shipped else {DIGEST: digest_of(flavour)}
    if plugins := module_plugins(flavour):
        found[MODULES] = listed({plugin.name: plugin.digest for plugin in plugins})
    return found


def listed(plugins: Mapping[str, str]) -> str:
    """Plugins with their digests as an entry of a header."""
    return ", ".join(f"{name} {digest}" for name, digest in plugins.items())


def plugins_in(entry: str) -> Iterator[tuple[str, str]]:
    """Names and digests of the plugins in an entry of a header; a name may come twice."""
    for word in entry.split(", "):
        name, _, digest = word.rpartition(" ")
        if name:
            yield name, digest


def is_changed(plugin: Plugin, header: Mapping[str, str]) -> bool:
    """Whether a header names modules of another version of a plugin."""
    known = {digest for name, digest in plugins_in(header.get(MODULES, "")) if name == plugin.name}
    return bool(known - {plugin.digest})


def load_beside(file: Path, header: Mapping[str, str]) -> None:
    """Run the plugins beside a file that its header names, and that are not loaded yet: what was copied to a robot.

    Raises:
        MissionError: One has another digest, or cannot be run.
    """
    for name, digest in plugins_in(header.get(MODULES, "")):
        place = file.parent / PLUGINS / name
        if name not in loaded_plugins() and Path(name).name == name and is_plugin(place):
            load_plugin(place, digest)


def ready(header: Mapping[str, str], named: str, flavour: str | None, label: str, file: Path | None) -> None:
    """Make sure that what a file needs is loaded; its flavour may lie beside it.

    Args:
        header: Of the file.
        named: The flavour that the file names.
        flavour: The flavour that a user has given instead: it is taken as it is now, with its modules.
        label: The file in errors.
        file: Its path; None if the text is of no file.

    Raises:
        FsmError: Something is missing, or has changed since the file was written.
    """
    if flavour is not None:
        return
    loaded = loaded_plugins()
    advice = "give it as it was then" + ", or --flavour to use all modules as they are now" * (file is not None)
    for name, digest in plugins_in(header.get(MODULES, "")):
        if name not in loaded:
            copies = [one / PLUGINS / name for one in _places(file) if Path(name).name == name]
            copy = next((shlex.quote(str(one)) for one in copies if is_plugin(one)), "with that plugin")
            raise FsmError(f"{label}: has modules of the plugin {excerpt(name)}; give --plugin {copy}")
        if loaded[name] != digest:
            raise FsmError(
                f"{label}: has modules of the plugin {excerpt(name)}, which has changed since this was designed: "
                f"expected digest {excerpt(digest)}, found {loaded[name]}; {advice}"
            )
    digest = header.get(DIGEST, "")
    if named not in flavour_names():
        place = next((one / FLAVOUR_FILE for one in _places(file) if (one / FLAVOUR_FILE).exists()), None)
        if place is None:
            known = ", ".join(flavour_names())
            advice = "; give its file with --flavour FILE.yaml" if digest else ""
            raise FsmError(f"{label}: flavour in the header: expected one of {known}, found '{excerpt(named)}'{advice}")
        found = load_flavour(str(place))
        if found.name != named:
            raise FsmError(f"{place}: expected the flavour {excerpt(named)} of {label}, found {found.name}")
    if digest and digest_of(flavour_of(named)) != digest:
        raise FsmError(
            f"{label}: the flavour {excerpt(named)} has changed since this was designed: expected digest "
            f"{excerpt(digest)}, found {digest_of(flavour_of(named))}; {advice}"
        )


def _places(file: Path | None) -> Iterable[Path]:
    """Folders in which files that a file needs may lie: beside it, or in the run folder of a failed experiment."""
    if file is None:
        return ()
    return (file.parent, file.parent.parent) if file.parent.name == "failed" else (file.parent,)
