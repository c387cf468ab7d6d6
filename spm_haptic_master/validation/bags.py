# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What `ros2 bag record` writes: directories and files of sqlite3 and MCAP, compressed or not.

They are read by rosbag2_py where that can be imported, as with an installed ROS 2, and elsewhere
by the library rosbags.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path, PurePath

from spm_haptic_master.exceptions import InputError
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
Content = tuple[dict[str, str], list[tuple[int, str, bytes]]]


def is_bag(path: Path) -> bool:
    """Return whether a path is of rosbag2: a directory, or a file of one of its formats."""
    return path.is_dir() or _stored_name(path.name).endswith(STORAGE_SUFFIXES)


def read_topic(
    path: Path, topic: str, optional: bool = False, option: str = '--topic'
) -> tuple[str, str, list[bytes]] | None:
    """
    Return name, type and serialized messages of the topic whose name is, or ends in, `topic`.

    An optional one without messages is None. InputError for a recording that was not ended,
    cannot be read or is incomplete, and where no or several such topics have messages: `option`
    is that of the program which names one.
    """
    compressed, counts = _metadata(path)
    types, messages = _read(path, compressed, topic)
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
        return name, types[name], [content for _, _, content in messages]
    if optional:
        return None
    raise InputError(
        f'{path}: nothing on topic {topic}; it has ' + (', '.join(sorted(types)) or 'no messages')
    )


def _metadata(path: Path) -> tuple[bool, Counter[str]]:
    """Return whether a recording is compressed, and its messages by topic, by metadata.yaml."""
    if not path.is_dir():
        if path.name.endswith(COMPRESSED_SUFFIX):
            raise InputError(
                f'{path}: compressed as a whole; expected its directory, with {METADATA}'
            )
        _check_ended(path)
        return False, Counter()
    try:
        content = yaml.safe_load((path / METADATA).read_text(encoding='utf-8'))
        about = content['rosbag2_bagfile_information']
        listed = [PurePath(name).name for name in about['relative_file_paths']]
        mode = str(about.get('compression_mode') or 'none').lower()
        counts: Counter[str] = Counter()
        for each in about['topics_with_message_count']:
            counts[each['topic_metadata']['name']] += int(each['message_count'])
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f'{path / METADATA}: cannot be read: {_first_line(error)}; '
            f'`ros2 bag reindex {path}` writes a new one'
        ) from error
    there = {_stored_name(each.name) for each in path.iterdir() if is_bag(each)}
    alone = sorted(there ^ {_stored_name(name) for name in listed})
    if alone:
        raise _not_ended(path, f'{", ".join(alone)} in the directory or {METADATA} alone', path)
    for name in listed:
        _check_ended(path / name)
    return mode != 'none', counts


def _check_ended(path: Path) -> None:
    """Raise InputError for an MCAP file without its end, and a database that was not closed."""
    if path.suffix == '.mcap' and path.is_file():
        with open(path, 'rb') as file:
            begin = file.read(len(MCAP_MAGIC))
            file.seek(max(0, path.stat().st_size - len(MCAP_MAGIC)))
            # rosbag2_py would read what is there.
            if begin == MCAP_MAGIC != file.read():
                raise _not_ended(path, 'no end of an MCAP file', path.parent)
    for suffix in SQLITE_REMAINS:
        beside = path.with_name(path.name + suffix)
        if path.suffix == '.db3' and beside.exists() and beside.stat().st_size:
            raise _not_ended(path, f'{beside.name} holds messages that are not in it', path.parent)


def _not_ended(path: Path, why: str, directory: Path) -> InputError:
    return InputError(
        f'{path}: {why}: the recording was not ended; `ros2 bag reindex '
        f'{directory}` makes it readable'
    )


def _stored_name(name: str) -> str:
    """Return the name of a file as it was before it was compressed."""
    return name.removesuffix(COMPRESSED_SUFFIX)


def _read(path: Path, compressed: bool, topic: str) -> Content:
    """Return the topics of a recording, and the messages of those named `topic`."""
    for read in (_by_rosbag2_py, _by_rosbags):
        try:
            return read(path, compressed, topic)
        except ImportError as error:
            missing = error
        except Exception as error:
            # The readers, their formats and their compressions have no common exception.
            directory = path if path.is_dir() else path.parent
            raise InputError(
                f'{path}: cannot be read as rosbag2: {type(error).__name__}: '
                f'{_first_line(error)}; if its recording was not ended, '
                f'`ros2 bag reindex {directory}` makes it readable'
            ) from error
    raise InputError(
        f'{path}: reading it needs rosbag2_py (apt install ros-jazzy-rosbag2-py, and source '
        'setup.bash of ROS 2), or rosbags (in a virtual environment: pip install '
        f"'.[validate]'): {missing}"
    ) from missing


def _select(names: Iterable[str], topic: str) -> list[str]:
    """Return the names that are, or end in, `topic`."""
    return [name for name in names if f'/{name.strip("/")}'.endswith(f'/{topic.strip("/")}')]


def _by_rosbag2_py(source: Path, compressed: bool, topic: str) -> Content:
    import rosbag2_py

    reader = (
        rosbag2_py.SequentialCompressionReader() if compressed else rosbag2_py.SequentialReader()
    )
    # Without a format to convert to, messages come as they are stored.
    reader.open(
        rosbag2_py.StorageOptions(uri=str(source), storage_id=''),
        rosbag2_py.ConverterOptions('', ''),
    )
    types = {topic.name: topic.type for topic in reader.get_all_topics_and_types()}
    chosen = _select(types, topic)
    messages = []
    if chosen:
        reader.set_filter(rosbag2_py.StorageFilter(topics=chosen))
        while reader.has_next():
            name, content, time = reader.read_next()
            messages.append((time, name, content))
    return types, messages


def _by_rosbags(source: Path, _: bool, topic: str) -> Content:
    from rosbags.rosbag2 import Reader

    with Reader(source) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        chosen = _select(types, topic)
        connections = [each for each in reader.connections if each.topic in chosen]
        messages = (
            [
                (time, connection.topic, bytes(content))
                for connection, time, content in reader.messages(connections=connections)
            ]
            if connections
            else []
        )
    return types, messages


def _first_line(error: Exception) -> str:
    return (str(error) or 'no reason given').splitlines()[0]
