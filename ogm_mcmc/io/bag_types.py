"""Types of stored messages: decoding them, and turning old ones into those of Jazzy.

Each type of a bag is read on its own, so that one that cannot be read leaves the others alone.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.base import normalize_fieldname

from ogm_mcmc.io.bag_storage import Definition

__all__ = ['MessageType', 'message_type', 'typestore']

HEADER = 'std_msgs/msg/Header'

# Not of the common interfaces, and old recordings come without definitions.
NAV2 = """geometry_msgs/Pose pose
float64 weight"""
NAV2_CLOUD = """std_msgs/Header header
nav2_msgs/Particle[] particles"""


def _jazzy() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(NAV2, 'nav2_msgs/msg/Particle'))
    store.register(get_types_from_msg(NAV2_CLOUD, 'nav2_msgs/msg/ParticleCloud'))
    return store


TYPESTORE = _jazzy()

# Before Iron nothing was written of the definitions, so the messages themselves have to tell.
OLDER = get_typestore(Stores.ROS2_HUMBLE)

READABLE = {'': '', 'ros2msg': 'msg', 'ros1msg': 'msg', 'ros2idl': 'idl', 'omgidl': 'idl'}


def typestore() -> Any:
    """Return the message types of Jazzy, as rosbags knows them."""
    return TYPESTORE


@lru_cache(maxsize=256)
def message_type(name: str, definition: Definition, serialization: str) -> MessageType:
    """Return a type; it takes a while to work one out, and recordings share them."""
    return MessageType(name, definition, serialization)


class MessageType:
    """One type as a bag defines it, `serialization` cdr or ros1.

    `problem` says why its messages cannot be read, `unsendable` why ROS 2 cannot send them; both
    are '' where all is well.
    """

    def __init__(self, name: str, definition: Definition, serialization: str) -> None:
        self.name = name
        self.definition = definition
        self.serialization = serialization

    @cached_property
    def problem(self) -> str:
        """Why messages of this type cannot be read."""
        if self.serialization not in ('cdr', 'ros1'):
            return f'its messages are encoded as {self.serialization or "nothing"!r}, not as cdr'
        if self.definition.encoding not in READABLE:
            return f'its type is defined in {self.definition.encoding!r}, not in ros2msg'
        try:
            store = self._store
            if self.name in store.fielddefs:
                store.get_msgdef(self.name)
                return ''
        except Exception:  # whatever the parser makes of a text that is no definition
            return f'the definition of its type {self.name} cannot be read'
        return f'its type {self.name or "(none)"} is not defined in the bag'

    @cached_property
    def unsendable(self) -> str:
        """Why messages of this type cannot be sent as those of Jazzy."""
        if self.serialization == 'cdr' and self.name not in TYPESTORE.fielddefs:
            return ''  # as they are, if the type is installed
        if self.problem:
            return self.problem
        if self.name not in TYPESTORE.fielddefs:
            return f'the ROS 2 form of {self.name} is not known'
        return self._differences(self.name)[1]

    @cached_property
    def _store(self) -> Any:
        encoding, text = self.definition
        if not text.strip() and encoding == '':
            return TYPESTORE
        store = get_typestore(Stores.EMPTY)
        if READABLE[encoding] == 'idl':
            separator = '=' * 80 + '\n'
            parts = text.split(separator) if text.startswith(f'{separator}IDL: ') else [text]
            for part in filter(None, parts):
                plain = part.split('\n', 1)[1] if part.startswith('IDL: ') else part
                store.register(get_types_from_idl(plain))
        else:
            store.register(get_types_from_msg(text, self.name))
        return store

    def decode(self, raw: bytes) -> Any:
        """Return a message object; anything may be raised for bytes that are none."""
        if self.problem:
            raise ValueError(self.problem)
        if self.serialization == 'ros1':
            return self._store.deserialize_ros1(raw, self.name)
        try:
            return self._store.deserialize_cdr(raw, self.name)
        except SerdeError:
            if not self._may_be_older:
                raise
            return OLDER.deserialize_cdr(raw, self.name)

    @cached_property
    def _may_be_older(self) -> bool:
        return (
            self._store is TYPESTORE
            and self.name in OLDER.fielddefs
            and OLDER.fielddefs[self.name][1] != TYPESTORE.fielddefs[self.name][1]
        )

    def to_cdr(self, raw: bytes) -> bytes:
        """Return what Jazzy sends; stored CDR of the same definition passes through untouched."""
        if self.unsendable:
            raise ValueError(self.unsendable)
        if self.serialization == 'cdr' and (len(raw) < 4 or raw[0] != 0):
            raise ValueError('no CDR')
        known = self.name in TYPESTORE.fielddefs
        same = not known or not self._differences(self.name)[0]
        if self.serialization == 'cdr' and same and not self._may_be_older:
            return raw
        if self.serialization == 'ros1' and same:
            return bytes(TYPESTORE.ros1_to_cdr(raw, self.name))
        message = _as_jazzy(self.decode(raw), self.name)
        return bytes(TYPESTORE.serialize_cdr(message, self.name))

    def _differences(self, name: str) -> tuple[bool, str]:
        """Return whether a type of the bag differs from Jazzy's, and why that cannot be mended."""
        if self._store is TYPESTORE:
            return False, ''
        own, differs = _fields(self._store, name), False
        for field, kind in _fields(TYPESTORE, name).items():
            stored = own.pop(field, None)
            if stored is None:
                differs = True
                if kind[0] is not Nodetype.BASE:
                    return True, f'{name} has no {field} here, which Jazzy has'
                continue
            if stored != kind:
                return True, f'{field} of {name} is of another type than in Jazzy'
            nested = _nested(kind)
            if nested:
                other, reason = self._differences(nested)
                if reason:
                    return True, reason
                differs = differs or other
        if own:
            return True, f'{name} has {", ".join(own)} here, which Jazzy has not'
        return differs, ''


def _fields(store: Any, name: str) -> dict[str, Any]:
    """Return the kinds of the fields by name; ROS 1 had another spelling and a `seq`."""
    fields = {field.lower(): kind for field, kind in store.fielddefs[name][1]}
    if name == HEADER:
        fields.pop('seq', None)
    return fields


def _nested(kind: Any) -> str:
    """Return the type a field holds one or more of; '' for numbers and texts."""
    node, detail = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        node, detail = detail[0]
    return str(detail) if node is Nodetype.NAME else ''


def _as_jazzy(message: Any, name: str) -> Any:
    """Return the message as Jazzy's type; what older ones had not is 0 or empty."""
    stored = {field.lower(): getattr(message, field) for field in message.__dataclass_fields__}
    values = []
    for field, kind in TYPESTORE.fielddefs[name][1]:
        value, nested = stored.get(normalize_fieldname(field).lower()), _nested(kind)
        if value is None:
            value = '' if kind[1][0] == 'string' else 0
        elif nested and isinstance(value, list):
            value = [_as_jazzy(member, nested) for member in value]
        elif nested:
            value = _as_jazzy(value, nested)
        values.append(value)
    return TYPESTORE.types[name](*values)
