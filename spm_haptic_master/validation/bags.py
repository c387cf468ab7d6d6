# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What `ros2 bag record` writes: directories and files of sqlite3 and MCAP, compressed or not.

They are read by the library rosbags, an extra: in a virtual environment, and with an installed
ROS 2 as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.axes import AXES
import yaml

# Suffixes of the files, and the one that compression of whole files appends.
STORAGE_SUFFIXES = ('.mcap', '.db3')
COMPRESSED_SUFFIX = '.zstd'
METADATA = 'metadata.yaml'
# First and last bytes of an MCAP file.
MCAP_MAGIC = b'\x89MCAP0\r\n'
# What sqlite3 keeps beside a database that was not closed, behind the name of the file.
SQLITE_REMAINS = ('-wal', '-journal')

# Topics with their types, and the messages of the wanted ones: log time (ns), topic, content.
Content = tuple[dict[str, str], list[tuple[int, str, Any]]]


def is_bag(path: Path) -> bool:
    """
    Return whether a path is of rosbag2: a directory, or a file of one of its formats.

    Parameters
    ----------
    path : Path
        A file or directory.

    Returns
    -------
    bool
        True for any directory, and for .mcap and .db3, compressed or not.

    """
    return path.is_dir() or _stored_name(path.name).endswith(STORAGE_SUFFIXES)


def read_topic(
    path: Path,
    topic: str,
    optional: bool = False,
    option: str = '--topic',
) -> tuple[str, str, list[Any]] | None:
    """
    Return the messages of a topic of a recording.

    Parameters
    ----------
    path : Path
        Directory of `ros2 bag record`, or one .mcap or .db3 file.
    topic : str
        Name of the topic, or its last parts.
    optional : bool, optional
        Whether the recording may lack it.
    option : str, optional
        Option of the program that names a topic, for the error.

    Returns
    -------
    tuple of str, str and list, or None
        Name, type and messages in the order of their times; None for an optional topic without
        messages.

    Raises
    ------
    InputError
        The recording was not ended, cannot be read or is incomplete; none or several such topics
        have messages.

    """
    counts = _metadata(path)
    types, messages = _read(path, topic)
    read = Counter(name for _, name, _ in messages)
    for name in _select(counts, topic):
        if read[name] != counts[name]:
            raise InputError(
                f'{path}: {read[name]} messages on {name}, {counts[name]} according to '
                f'{METADATA}; `ros2 bag reindex {path}` counts them again'
            )
    if len(read) > 1:
        raise InputError(
            f'{path}: {topic} is ambiguous: {", ".join(sorted(read))}; name one by {option}'
        )
    for name in read:
        # The files of a recording may overlap in time, and be listed in any order.
        messages.sort(key=lambda message: message[0])
        contents = [content for _, _, content in messages]
        return name, types[name], contents
    if optional:
        return None
    raise InputError(
        f'{path}: nothing on topic {topic}; it has ' + (', '.join(sorted(types)) or 'no messages')
    )


def _metadata(path: Path) -> Counter[str]:
    """
    Return the number of messages by topic, as metadata.yaml has them.

    The files in the directory have to be those that it lists, and to be ended.

    Parameters
    ----------
    path : Path
        Directory or file of the recording.

    Returns
    -------
    Counter of str
        Empty for a file alone, which has no metadata.

    Raises
    ------
    InputError
        It cannot be read, is incomplete, or the recording was not ended.

    """
    if not path.is_dir():
        if path.name.endswith(COMPRESSED_SUFFIX):
            raise InputError(
                f'{path}: compressed as a whole; expected its directory, with {METADATA}'
            )
        _check_ended(path)
        return Counter()
    about = _read_metadata(path)
    _check_storage(path, about)
    bags = filter(is_bag, path.iterdir())
    present = {_stored_name(bag.name) for bag in bags}
    listed = {_stored_name(name) for name in about.files}
    alone = sorted(present ^ listed)
    if alone:
        raise _not_ended(path, f'{", ".join(alone)} in the directory or {METADATA} alone', path)
    for name in about.files:
        _check_ended(path / name)
    return about.counts


@dataclass(frozen=True, slots=True)
class _Metadata:
    """
    What metadata.yaml says of a recording.

    Attributes
    ----------
    files : list of str
        Names of its files.
    storage : str or None
        Storage format.
    counts : Counter of str
        Number of messages by topic.

    """

    files: list[str]
    storage: str | None
    counts: Counter[str]


def _read_metadata(path: Path) -> _Metadata:
    """Return what metadata.yaml in a directory says; InputError where it cannot be read."""
    try:
        text = (path / METADATA).read_text(encoding='utf-8')
        content = yaml.safe_load(text)
        about = content['rosbag2_bagfile_information']
        files = [PurePath(name).name for name in about['relative_file_paths']]
        counts: Counter[str] = Counter()
        for counted in about['topics_with_message_count']:
            topic = counted['topic_metadata']['name']
            counts[topic] += int(counted['message_count'])
        return _Metadata(
            files=files,
            storage=about.get('storage_identifier'),
            counts=counts,
        )
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f'{path / METADATA}: cannot be read: {_first_line(error)}; '
            f'`ros2 bag reindex {path}` writes a new one'
        ) from error


def _check_storage(path: Path, about: _Metadata) -> None:
    """Raise InputError for metadata without the storage format, with what belongs there."""
    if about.storage == '':
        formats = sorted({_storage_of(name) for name in about.files})
        suffixes = ' or '.join(formats)
        raise InputError(
            f'{path / METADATA}: storage_identifier is empty, as `ros2 bag reindex` of Humble '
            f'leaves it; write {suffixes} there'
        )


def _storage_of(name: str) -> str:
    """Return rosbag2's name of the storage format of a file."""
    if _stored_name(name).endswith('.mcap'):
        return 'mcap'
    return 'sqlite3'


def _check_ended(path: Path) -> None:
    """Raise InputError for an MCAP file without its end, and a database that was not closed."""
    if path.suffix == '.mcap' and path.is_file():
        with open(path, 'rb') as file:
            begin = file.read(len(MCAP_MAGIC))
            size = path.stat().st_size
            file.seek(max(0, size - len(MCAP_MAGIC)))
            # A reader may take what is there.
            if begin == MCAP_MAGIC != file.read():
                raise _not_ended(path, 'no end of an MCAP file', path.parent)
    for suffix in SQLITE_REMAINS:
        beside = path.with_name(path.name + suffix)
        has_remains = beside.exists() and beside.stat().st_size > 0
        if path.suffix == '.db3' and has_remains:
            raise _not_ended(path, f'{beside.name} holds messages that are not in it', path.parent)


def _not_ended(
    path: Path,
    why: str,
    directory: Path,
) -> InputError:
    """Return the error for a recording that was not ended, with what makes it readable."""
    return InputError(
        f'{path}: {why}: the recording was not ended; `ros2 bag reindex '
        f'{directory}` makes it readable'
    )


def _stored_name(name: str) -> str:
    """Return the name of a file as it was before it was compressed."""
    return name.removesuffix(COMPRESSED_SUFFIX)


def _read(path: Path, topic: str) -> Content:
    """
    Return the topics of a recording, and the messages of those named `topic`.

    Parameters
    ----------
    path : Path
        Directory or file of the recording.
    topic : str
        Name of the topic, or its last parts.

    Returns
    -------
    types : dict of str to str
        Type of each topic.
    messages : list of tuple
        Log time, ns, topic and message.

    Raises
    ------
    InputError
        Rosbags is not installed, or cannot read the recording.

    """
    try:
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import get_typestore, Stores
    except ImportError as error:
        raise InputError(
            f'{path}: reading it needs rosbags (in a virtual environment: pip install '
            f"'.[validate]'): {error}"
        ) from error
    store = get_typestore(Stores.ROS2_JAZZY)
    messages = []
    try:
        with Reader(path) as reader:
            types = {connection.topic: connection.msgtype for connection in reader.connections}
            chosen = _select(types, topic)
            connections = [each for each in reader.connections if each.topic in chosen]
            # Without a connection the reader would return all messages.
            if connections:
                for connection, time, content in reader.messages(connections=connections):
                    messages.append((time, connection.topic, bytes(content)))
    except Exception as error:
        # The formats and their compressions have no common exception.
        directory = path if path.is_dir() else path.parent
        raise InputError(
            f'{path}: cannot be read as rosbag2: {type(error).__name__}: {_first_line(error)}; if '
            f'its recording was not ended, `ros2 bag reindex {directory}` makes it readable'
        ) from error
    found = []
    for number, (time, name, content) in enumerate(messages, 1):
        message = _message(path, store, name, types[name], number, content)
        found.append((time, name, message))
    return types, found


def _message(
    path: Path,
    store: Any,
    topic: str,
    kind: str,
    number: int,
    content: bytes,
) -> Any:
    """Return a message by its content; InputError where it is not of its type."""
    try:
        return store.deserialize_cdr(content, kind)
    except Exception as error:
        raise InputError(
            f'{path}: message {number} on {topic}: not as expected: {_first_line(error)}'
        ) from error


def _select(
    names: Iterable[str],
    topic: str,
) -> list[str]:
    """Return the names that are, or end in, `topic`; those of an axis only if it has the axis."""
    ending = f'/{topic.strip("/")}'
    of_axes = tuple(f'/{axis}{ending}' for axis in AXES)
    found = []
    for name in names:
        full = f'/{name.strip("/")}'
        if full.endswith(ending) and not full.endswith(of_axes):
            found.append(name)
    return found


def _first_line(error: Exception) -> str:
    """Return the first line of an error's text."""
    return (str(error) or 'no reason given').splitlines()[0]
