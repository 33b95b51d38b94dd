"""Frames of a SocketCAN socket as the kernel keeps them (struct can_frame), and all that have arrived by one system call.

Layouts after the man pages recvmmsg(2), cmsg(3), and the kernel's Documentation/networking/can.rst.
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct

BATCH = 128
"""Frames that one system call takes at most."""
NS_PER_S = 1_000_000_000
_FRAME = struct.Struct("=IB3x8s")
_STAMP = struct.Struct("@qq")
_CONTROL_HEADER = struct.Struct("@nii")
"""cmsg_len, cmsg_level, cmsg_type; the stamp follows."""
_CONTROL_BYTES = _CONTROL_HEADER.size + _STAMP.size


class _Vector(ctypes.Structure):
    _fields_ = [("base", ctypes.c_void_p), ("length", ctypes.c_size_t)]


class _Message(ctypes.Structure):
    """struct mmsghdr: a struct msghdr and the length that was received."""

    _fields_ = [
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("vectors", ctypes.POINTER(_Vector)),
        ("vector_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
        ("padding", ctypes.c_int),
        ("received", ctypes.c_uint32),
    ]


def pack(can_id: int, data: bytes) -> bytes:
    """struct can_frame."""
    return _FRAME.pack(can_id, len(data), data)


class FrameReader:
    """Reads a socket that stamps what it receives (SO_TIMESTAMPNS) without ever waiting."""

    def __init__(self, fileno: int) -> None:
        self._fileno = fileno
        self._receive = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._frames = (ctypes.c_char * (BATCH * _FRAME.size))()
        self._control = (ctypes.c_char * (BATCH * _CONTROL_BYTES))()
        self._vectors = (_Vector * BATCH)()
        self._messages = (_Message * BATCH)()
        frames, control = ctypes.addressof(self._frames), ctypes.addressof(self._control)
        for i, (vector, message) in enumerate(zip(self._vectors, self._messages, strict=True)):
            vector.base, vector.length = frames + i * _FRAME.size, _FRAME.size
            message.vectors, message.vector_count = ctypes.pointer(vector), 1
            message.control = control + i * _CONTROL_BYTES
            message.control_length = _CONTROL_BYTES
        self._fresh = bytes(self._messages)
        """The kernel writes over lengths and flags: they are restored before the next call."""

    def read(self) -> list[tuple[int, int, bytes]]:
        """(stamp in nanoseconds of the real-time clock, identifier with its flags, data) of all that is there.

        Raises OSError when the socket or its interface has gone away.
        """
        found: list[tuple[int, int, bytes]] = []
        while True:
            count = self._receive(self._fileno, self._messages, BATCH, socket.MSG_DONTWAIT, None)
            if count < 0:
                number = ctypes.get_errno()
                if number in (errno.EAGAIN, errno.EINTR):
                    return found
                raise OSError(number, os.strerror(number))
            frames = _FRAME.iter_unpack(memoryview(self._frames)[: count * _FRAME.size])
            for i, (can_id, length, data) in enumerate(frames):
                seconds, nanoseconds = _STAMP.unpack_from(self._control, i * _CONTROL_BYTES + _CONTROL_HEADER.size)
                found.append((seconds * NS_PER_S + nanoseconds, can_id, data[:length]))
            ctypes.memmove(self._messages, self._fresh, count * ctypes.sizeof(_Message))
            if count < BATCH:
                return found
