"""Files of control software: fsm.txt, a line of its text below comments, and fsm.yaml, a PFSM that people read.

A file is read by what is in it, so either may have any name: robots get a copy of either as fsm.txt.
"""

import contextlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mercator_design.errors import FsmError, excerpt
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.words.names import is_state_name
from mercator_design.modules.architecture import Architecture, Software, Warn, out_of_domain
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, flavour_names, other_flavour
from mercator_design.network.genome import genomes_of, is_genome
from mercator_design.network.network import DEFAULT_FLAVOUR as NETWORKS
from mercator_design.software.architectures import ARCHITECTURES, architecture_of, text_of
from mercator_design.software.needed import NEEDED, entries_of, ready
from mercator_design.system.files import small_text

_MAX_SIZE = 64 * 1024
_MAX_SET = 4 * 1024 * 1024
_FLAVOUR, _NAMES = "flavour", "state names"
"""Keys of the header of an fsm.txt that say what the PFSM is; the others say what is known of it."""
_YAML_BEGINS = re.compile(r"""---|\{|["']?[\w ]+["']?\s*:(\s|$)""")
"""How the first line of an fsm.yaml begins that is no comment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FsmFile:
    """The contents of a file of control software."""

    software: Software
    header: Mapping[str, str]  # what is known of it: the comment lines of an fsm.txt, or `header` of an fsm.yaml
    names: tuple[str, ...] = ()  # of its parts, for example states; by default the usual ones

    def __post_init__(self) -> None:
        if not self.names:
            object.__setattr__(self, "names", architecture_of(self.software.flavour).names(self.software))

    def __repr__(self) -> str:
        of = f" of {excerpt(self.header['mission'])}" if "mission" in self.header else ""
        return f"<FsmFile{of}: {self.software.summary}>"

    @property
    def pfsm(self) -> Pfsm:
        """The PFSM.

        Raises:
            FsmError: It is control software of another architecture.
        """
        if not isinstance(self.software, Pfsm):
            noun = architecture_of(self.software.flavour).noun
            raise FsmError(f"expected a PFSM, found a {noun} ({self.software.flavour}): this is done with PFSMs only")
        return self.software


def read_fsm(path: Path, flavour: str | None = None, *, tolerate: Warn | None = None) -> FsmFile:
    """Read an fsm.txt, an fsm.yaml or the genome of a network.

    Args:
        path: The file.
        flavour: Overrides the file's; without either it is watermelon, or of a genome evostick.
        tolerate: As for `parse`; in an fsm.yaml, parameters may be outside their domains. A trailing line `score X`
            in an fsm.txt, as target runners log it, is accepted in any case.

    Raises:
        FsmError: naming file and line.
    """
    return fsm_of(small_text(path, _MAX_SIZE, FsmError), str(path), flavour, tolerate=tolerate, path=path)


def read_header(path: Path) -> dict[str, str]:
    """The header of a file, whatever else is in it; empty if it has none.

    Raises:
        FsmError: The file cannot be read.
    """
    text = small_text(path, _MAX_SET, FsmError)
    return _yaml_header(text)[1] if _is_yaml(text) else _lines(text)[0]


def fsm_of(
    text: str, label: str, flavour: str | None = None, *, tolerate: Warn | None = None, path: Path | None = None
) -> FsmFile:
    """As `read_fsm`, of the text of a file; `label` names it in errors, and `path` is where it lies."""
    if _is_yaml(text):
        return _read_yaml(text, label, flavour, tolerate, path)
    if is_genome(text):
        genomes = _genome_files(text, label, flavour)
        if len(genomes) != 1:
            raise FsmError(f"{label}: expected one genome, found {len(genomes)}")
        return genomes[0]
    header, found = _lines(text)
    if len(found) != 1:
        where = ", ".join(f"line {number}" for number, _ in found[:3]) or "none"
        raise FsmError(f"{label}: expected one line with control software, found {len(found) or 'none'} ({where})")
    return _read_line(*found[0], header, label, flavour, tolerate, path)


def read_fsms(path: Path, flavour: str | None = None, *, tolerate: Warn | None = None) -> dict[int, FsmFile]:
    """Read a file of control software, one on each line, as published data sets have them; by the number of the line.

    The genomes of a file are counted from 1. The comment lines are about all of them. A file that `read_fsm` reads has
    one. Arguments and errors are those of `read_fsm`.
    """
    text = small_text(path, _MAX_SET, FsmError)
    if is_genome(text):
        return dict(enumerate(_genome_files(text, str(path), flavour), start=1))
    header, found = _lines(text)
    if _is_yaml(text) or len(found) < 2:
        return {1: read_fsm(path, flavour, tolerate=tolerate)}
    return {number: _read_line(number, line, header, str(path), flavour, tolerate, path) for number, line in found}


def _is_yaml(text: str) -> bool:
    content = (line.strip() for line in text.splitlines())
    first = next((line for line in content if line and not line.startswith("#")), "")
    return _YAML_BEGINS.match(first) is not None


def _yaml_header(text: str) -> tuple[str, dict[str, str]]:
    """The flavour and the header of an fsm.yaml, as far as they are what they should be."""
    import yaml

    try:
        found = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError):  # reported when it is read
        return DEFAULT_FLAVOUR, {}
    named, header = (found.get("flavour"), found.get("header")) if isinstance(found, dict) else (None, None)
    texts = header.items() if isinstance(header, dict) else ()
    return str(named or DEFAULT_FLAVOUR), {str(key): value for key, value in texts if isinstance(value, str)}


def _read_yaml(text: str, label: str, flavour: str | None, tolerate: Warn | None, path: Path | None) -> FsmFile:
    from mercator_design.fsm.yaml_form import parse_yaml

    lenient = tolerate is not None
    named_flavour, found = _yaml_header(text)
    if found.keys() & NEEDED:
        ready(found, named_flavour, flavour, label, path)
    try:
        named = parse_yaml(text, label, flavour, any_domain=lenient)
    except FsmError as error:
        hint = other_flavour(flavour, "pfsm", lambda other: parse_yaml(text, label, other, any_domain=lenient))
        raise FsmError(*error.messages[:-1], error.messages[-1] + hint) from None
    pfsm = named.pfsm(any_domain=lenient)
    if tolerate:
        out_of_domain(pfsm, tolerate)
    header = {key: " ".join(value.split()) for key, value in (named.header or {}).items() if key not in NEEDED}
    for key in (_FLAVOUR, _NAMES):
        if key in header:
            raise FsmError(
                f"{label}: header: expected no key '{key}': an fsm.yaml says this at its top and in its states"
            )
    return FsmFile(software=pfsm, header=header, names=named.names)


def _genome_files(text: str, label: str, flavour: str | None) -> list[FsmFile]:
    """The networks of a file of genomes, each with its number and its fitness, if it is there."""
    found = []
    for genome in genomes_of(text, label, flavour or NETWORKS):
        fitness = {} if genome.fitness is None else {"fitness": f"{genome.fitness:g}"}
        found.append(FsmFile(software=genome.network, header={"genome": str(genome.number), **fitness}))
    return found


def _lines(text: str) -> tuple[dict[str, str], list[tuple[int, str]]]:
    """The header of an fsm.txt, and its lines with a PFSM, with their numbers."""
    header: dict[str, str] = {}
    found: list[tuple[int, str]] = []
    for number, line in enumerate((line.strip() for line in text.splitlines()), start=1):
        if line.startswith("#"):
            key, _, value = line.lstrip("# ").partition(":")
            if _ and key.strip():
                header[" ".join(key.split())] = " ".join(value.split())
        elif line and not re.fullmatch(r"score\s+\S+", line):
            found.append((number, line))
    return header, found


def _read_line(
    number: int,
    line: str,
    header: Mapping[str, str],
    label: str,
    flavour: str | None,
    tolerate: Warn | None,
    path: Path | None,
) -> FsmFile:
    named = header.get(_FLAVOUR, DEFAULT_FLAVOUR)
    ready(header, named, flavour, label, path)
    header = {key: value for key, value in header.items() if key not in {_FLAVOUR, *NEEDED}}
    try:
        software = parse_software(line, flavour or named, tolerate=tolerate)
    except FsmError as error:
        raise FsmError(f"{label}:{number}: {error}") from None
    names = tuple(name.strip() for name in header.pop(_NAMES).split(",")) if _NAMES in header else ()
    usual = architecture_of(software.flavour).names(software)
    if names and not (len(set(names)) == len(names) == len(usual) and all(map(is_state_name, names))):
        expected = f"expected {len(usual)} different names with commas between"
        raise FsmError(f"{label}: {_NAMES} in the header: {expected}, found '{excerpt(', '.join(names))}'")
    return FsmFile(software=software, header=header, names=names)


def parse_software(line: str, flavour: str, *, tolerate: Warn | None = None) -> Software:
    """The control software of a text; arguments and errors are those of `Architecture.parse`.

    The error says so if the text is of another architecture, with the flavour to give.
    """
    try:
        software: Software = architecture_of(flavour).parse(line, flavour, tolerate=tolerate)
    except FsmError:
        for other in ARCHITECTURES.values():
            if other is not architecture_of(flavour) and (found := _flavours_of(line, other)):
                noun, names = other.noun, " or ".join(found)
                raise FsmError(f"this is a {noun} of {names}; use --flavour {found[0]}") from None
        raise
    return software


def _flavours_of(line: str, architecture: Architecture) -> list[str]:
    """The flavours of an architecture that can read a text."""
    found = []
    for flavour in flavour_names(architecture.name):
        with contextlib.suppress(FsmError):
            architecture.parse(line, flavour)
            found.append(flavour)
    return found


def fsm_file_text(software: Software, header: Mapping[str, str], names: tuple[str, ...] = ()) -> str:
    """The text of an fsm.txt; the flavour is always in its header, names of parts if they are not the usual ones."""
    entries = {_FLAVOUR: software.flavour, **entries_of(software.flavour), **header}
    if names and names != architecture_of(software.flavour).names(software):
        entries[_NAMES] = ", ".join(names)
    comments = [f"# {key}: {' '.join(str(value).split())}" for key, value in entries.items()]
    return "\n".join([*comments, text_of(software)]) + "\n"


def fsm_yaml_text(file: FsmFile) -> str:
    """The text of an fsm.yaml, without loss."""
    from mercator_design.fsm.yaml_form import to_yaml

    if not isinstance(file.software, Pfsm):
        noun = architecture_of(file.software.flavour).noun
        raise FsmError(f"fsm.yaml is a form of PFSMs, found a {noun} ({file.software.flavour}): its form is fsm.txt")
    return to_yaml(file.pfsm, file.names, {**entries_of(file.pfsm.flavour), **file.header})
