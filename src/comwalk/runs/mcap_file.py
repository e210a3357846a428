"""MCAP files, written chunk by chunk, and read up to where they end or were cut off.

A file is records, each with its kind and its length in front; messages are in
compressed chunks. Whatever stands whole before a cut can be read, and of the chunk that
was cut, what its compressed bytes still give.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, TypeAlias, TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from ..errors import RunError
from .ros_messages import definition

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of a file."""
LIBRARY = "comwalk"
"""What the files say of who wrote them."""
MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""What stands before the bytes of a message in a chunk."""
_PREFIX = struct.Struct("<BQ")  # kind and length of a record
_LEVEL = 1  # of compression: numbers of a walk hardly shrink more
_STRANGE = (McapError, struct.error, ValueError, zstandard.ZstdError)

Index: TypeAlias = Mapping[int, np.ndarray]
"""Times [ns] and places of the messages in a chunk, of shape (n, 2), by channel."""


@dataclass(frozen=True)
class Topic:
    """A topic of a file."""

    name: str
    """Its name."""
    kind: str
    """Type of its messages, such as "geometry_msgs/PointStamped"."""
    latched: bool = False
    """Whether who comes late is to get the last message."""


# ---- Writing ----------------------------------------------------------------------


class McapWriter:
    """Writes a file; what was written can be read whatever happens then. Final."""

    def __init__(self, file: BinaryIO) -> None:
        """Begin a file.

        Args:
            file: Open for writing, at its start.
        """
        self._file, self._place = file, 0
        self._kinds: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._notes: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._write(MAGIC + _bytes_of(Header("ros2", LIBRARY)))

    def add_topics(self, topics: Sequence[Topic]) -> None:
        """Name topics; the first has the id 1.

        Args:
            topics: All topics of the file.
        """
        kinds = list(dict.fromkeys(topic.kind for topic in topics))
        for i, kind in enumerate(kinds, start=1):
            name, text = kind.replace("/", "/msg/"), definition(kind).encode()
            schema = Schema(id=i, name=name, encoding="ros2msg", data=text)
            self._kinds.append(schema)
        for i, topic in enumerate(topics, start=1):
            channel = Channel(
                id=i,
                topic=topic.name,
                message_encoding="cdr",
                metadata={"offered_qos_profiles": qos(topic.latched)},
                schema_id=1 + kinds.index(topic.kind),
            )
            self._channels.append(channel)
        self._write(_bytes_of(*self._kinds, *self._channels))
        self._file.flush()

    def add_notes(self, name: str, notes: Mapping[str, str]) -> None:
        """Write names and texts.

        Args:
            name: What they are about.
            notes: Texts by name.
        """
        record = _bytes_of(Metadata(name, dict(notes)))
        self._notes.append(MetadataIndex(self._place, len(record), name))
        self._write(record)
        self._file.flush()

    def add_chunk(self, messages: bytes, index: Index) -> None:
        """Write messages; they are in the file when this returns.

        Args:
            messages: Records of messages, one after the other.
            index: When and where they are; no channel is without messages.
        """
        times = [each[:, 0] for each in index.values()]
        first, last = min(int(t[0]) for t in times), max(int(t[-1]) for t in times)
        data = zstandard.ZstdCompressor(level=_LEVEL).compress(messages)
        size, crc = len(messages), zlib.crc32(messages)
        start = self._place
        self._write(_bytes_of(Chunk("zstd", data, last, first, crc, size)))
        length, places = self._place - start, {}
        indices = b""
        for channel, entries in index.items():
            places[channel] = self._place + len(indices)
            indices += _index_bytes(channel, entries)
            self._counts[channel] = self._counts.get(channel, 0) + len(entries)
        self._write(indices)
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=start,
                compression="zstd",
                compressed_size=len(data),
                message_end_time=last,
                message_index_length=len(indices),
                message_index_offsets=places,
                message_start_time=first,
                uncompressed_size=size,
            )
        )
        self._file.flush()

    def finish(self) -> None:
        """Write what makes a file quick to search; nothing can be added then."""
        self._write(_bytes_of(DataEnd(0)))
        start, offsets, summary = self._place, [], b""
        for records in (
            self._kinds,
            self._channels,
            [self._statistics()],
            self._chunks,
            self._notes,
        ):
            group = _bytes_of(*records)
            if group:
                place = start + len(summary)
                offsets.append(SummaryOffset(group[0], place, len(group)))
                summary += group
        table = start + len(summary)
        summary += _bytes_of(*offsets)
        fields = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, table)
        crc = zlib.crc32(summary + fields)
        self._write(summary + _bytes_of(Footer(start, table, crc)) + MAGIC)
        self._file.flush()

    def _statistics(self) -> Statistics:
        """Return how much is in the file."""
        first = min((c.message_start_time for c in self._chunks), default=0)
        last = max((c.message_end_time for c in self._chunks), default=0)
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._notes),
            message_start_time=first,
            message_end_time=last,
            schema_count=len(self._kinds),
        )

    def _write(self, data: bytes) -> None:
        """Append bytes."""
        self._file.write(data)
        self._place += len(data)


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _index_bytes(channel: int, entries: np.ndarray) -> bytes:
    pairs = np.ascontiguousarray(entries, "<u8").tobytes()
    head = _PREFIX.pack(Opcode.MESSAGE_INDEX, 6 + len(pairs))
    return head + struct.pack("<HI", channel, len(pairs)) + pairs


def qos(latched: bool) -> str:
    """Return the quality of service that ROS 2 is to offer, as rosbag2 writes it.

    Args:
        latched: Whether who comes late is to get the last message.

    Returns:
        YAML.
    """
    policies = {"history": 3 - 2 * latched, "depth": int(latched), "reliability": 1}
    policies["durability"] = 1 if latched else 2
    lines = [f"{name}: {value}" for name, value in policies.items()]
    for name in ("deadline", "lifespan"):
        lines += [f"{name}:", "  sec: 9223372036", "  nsec: 854775807"]
    lines += ["liveliness: 1", "liveliness_lease_duration:"]
    lines += ["  sec: 9223372036", "  nsec: 854775807"]
    lines += ["avoid_ros_namespace_conventions: false"]
    return "- " + "\n  ".join(lines)


# ---- Reading ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Block:
    """Messages of one chunk, as many as are whole."""

    messages: bytes
    """Their records, one after the other."""
    heads: np.ndarray
    """What stands before each, of the dtype `MESSAGE`."""
    starts: np.ndarray
    """Where each record starts in the bytes."""

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.starts)

    def of(self, channel: int) -> tuple[np.ndarray, list[bytes]]:
        """Return the messages of a channel.

        Args:
            channel: Its id.

        Returns:
            Times [ns], and the messages.
        """
        chosen = np.flatnonzero(self.heads["channel"] == channel)
        begins = (self.starts[chosen] + MESSAGE.itemsize).tolist()
        ends = (self.starts + _PREFIX.size + self.heads["length"].astype(int))[
            chosen
        ].tolist()
        data = [self.messages[a:b] for a, b in zip(begins, ends, strict=True)]
        return self.heads["log_time"][chosen], data

    def index(self) -> dict[int, np.ndarray]:
        """Return when and where the messages are, by channel."""
        channels = list(dict.fromkeys(self.heads["channel"].tolist()))
        pairs = np.stack([self.heads["log_time"], self.starts.astype("<u8")], axis=1)
        return {c: pairs[self.heads["channel"] == c] for c in channels}


@dataclass(frozen=True)
class End:
    """Where reading ended."""

    whole: bool
    """Whether the file was finished, not cut off."""
    place: int
    """Where the last thing that could be read ends [bytes]."""
    size: int
    """Size of the file [bytes]."""


Item: TypeAlias = Schema | Channel | Metadata | Block | End
"""What a file holds, in order; `End` comes last."""

_READABLE = {
    int(Opcode.SCHEMA): Schema,
    int(Opcode.CHANNEL): Channel,
    int(Opcode.METADATA): Metadata,
}


_Record = TypeVar("_Record", bound=McapRecord)


def read_mcap(path: Path) -> Iterator[Item]:
    """Read a file that comwalk wrote, up to where it was cut off.

    Args:
        path: The file.

    Yields:
        All that is whole, in order, and at last the end.

    Raises:
        RunError: If it cannot be read, or is no such file.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            yield from _items(file, path, size)
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror}") from None


def _items(file: BinaryIO, path: Path, size: int) -> Iterator[Item]:
    """Yield what is whole in an open file."""
    magic = file.read(len(MAGIC))
    if not MAGIC.startswith(magic):
        raise RunError(f"{path} is no MCAP file")
    place, in_data = file.tell(), len(magic) == len(MAGIC)
    while in_data or place < size:
        head = file.read(_PREFIX.size)
        if len(head) < _PREFIX.size:
            break
        kind, length = _PREFIX.unpack(head)
        body = file.read(min(length, size - file.tell()))
        whole = len(body) == length
        if kind == Opcode.CHUNK and in_data:
            block, whole = _block(body, whole)
            if len(block):
                yield block
        if not whole:
            break
        if kind == Opcode.FOOTER:
            if file.read(len(MAGIC)) == MAGIC:
                yield End(True, size, size)
                return
            break
        if kind == Opcode.HEADER:
            _check_header(body, path)
        elif kind in _READABLE and in_data:
            yield _parsed(_READABLE[kind].read, body, path)
        in_data &= kind != Opcode.DATA_END
        place = file.tell()
    yield End(False, place, size)


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _check_header(body: bytes, path: Path) -> None:
    """Refuse a file of another program, whose messages may be anything."""
    library = _parsed(Header.read, body, path).library
    if library != LIBRARY:
        raise RunError(f"{path} was written by {library!r}, not by comwalk")


def _parsed(
    read: Callable[[ReadDataStream], _Record], body: bytes, path: Path
) -> _Record:
    try:
        return read(_stream(body))
    except _STRANGE:
        raise RunError(f"{path} is broken: a record in it is unreadable") from None


def _block(body: bytes, whole: bool) -> tuple[Block, bool]:
    """Return the whole messages of a chunk, and whether it is whole itself."""
    stream = _stream(body)
    try:
        stream.read(16)  # times
        size, crc = stream.read8(), stream.read4()
        compression = stream.read_prefixed_string()
        stream.read8()  # length of the rest
        data = body[stream.count :]
        if compression == "zstd":
            data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except _STRANGE:
        return _split(b""), False
    if whole and (len(data) != size or zlib.crc32(data) != crc):
        return _split(b""), False
    return _split(data), whole


def _split(data: bytes) -> Block:
    """Return the records of messages that are whole in some bytes."""
    starts, place = [], 0
    while place + MESSAGE.itemsize <= len(data):
        kind, length = _PREFIX.unpack_from(data, place)
        end = place + _PREFIX.size + length
        if end > len(data) or kind != Opcode.MESSAGE:
            break
        starts.append(place)
        place = end
    where = np.array(starts, np.int64)
    everything = np.frombuffer(data, np.uint8)
    rows = everything[where[:, None] + np.arange(MESSAGE.itemsize)]
    return Block(data[:place], rows.reshape(-1).view(MESSAGE), where)
