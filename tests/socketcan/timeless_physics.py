"""`python -m canipulator …` with a PyBullet that does not ask what time it is: for kernels where that is a system call.

    timeless_physics.py sim --bus socketcan:vcan0 ...

PyBullet reads the clock 45 times in a step of the simulation, for time-outs of connections that a simulation in the same process
does not have. Elsewhere that costs 30 ns each; in a user-mode kernel, which has no clock page, 10 to 17 µs: half of real time.
Its import of `gettimeofday` is bound to a function that says 0, as LD_PRELOAD would do it, which needs a compiler.
"""

import ctypes
import mmap
import runpy
import struct

import pybullet

SAYS_ZERO = bytes.fromhex("48c7070000000048c747080000000031c0c3")
"""tv->tv_sec = 0; tv->tv_usec = 0; return 0, on x86-64."""
_JUMP_RELOCATIONS, _JUMP_BYTES, _RELOCATIONS, _BYTES, _SYMBOLS, _STRINGS = 23, 2, 7, 8, 6, 5
"""DT_JMPREL, DT_PLTRELSZ, DT_RELA, DT_RELASZ, DT_SYMTAB, DT_STRTAB of the ELF specification."""


class _Library(ctypes.Structure):
    """The beginning of struct link_map, which a handle of dlopen points to."""

    _fields_ = [("base", ctypes.c_uint64), ("name", ctypes.c_char_p), ("dynamic", ctypes.c_uint64)]


def slots(path: str, symbol: bytes) -> list[int]:
    """Addresses at which a loaded library keeps the address of a function that it imports."""
    library = ctypes.cast(ctypes.CDLL(path)._handle, ctypes.POINTER(_Library)).contents
    tags, at = {}, library.dynamic
    while (entry := struct.unpack("qQ", ctypes.string_at(at, 16)))[0]:
        tags[entry[0]] = entry[1]
        at += 16
    found = []
    for start, size in ((_JUMP_RELOCATIONS, _JUMP_BYTES), (_RELOCATIONS, _BYTES)):
        table = ctypes.string_at(tags[start], tags[size]) if start in tags else b""
        for offset, info, _ in struct.iter_unpack("QQq", table):
            (name,) = struct.unpack("I", ctypes.string_at(tags[_SYMBOLS] + 24 * (info >> 32), 4))
            if info >> 32 and ctypes.string_at(tags[_STRINGS] + name) == symbol:
                found.append(library.base + offset)
    return found


def stop_the_clock() -> None:
    """Binds PyBullet's `gettimeofday` anew. Raises RuntimeError where it has none."""
    places = slots(pybullet.__file__, b"gettimeofday")
    if not places:
        raise RuntimeError(f"{pybullet.__file__} does not import gettimeofday: see whether this is still needed")
    code = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    code.write(SAYS_ZERO)
    address = ctypes.addressof(ctypes.c_char.from_buffer(code))
    for place in places:
        page = place & -mmap.PAGESIZE
        ctypes.CDLL(None).mprotect(ctypes.c_void_p(page), mmap.PAGESIZE, mmap.PROT_READ | mmap.PROT_WRITE)
        ctypes.c_uint64.from_address(place).value = address
    globals()["_code"] = code  # stays as long as the process


if __name__ == "__main__":
    stop_the_clock()
    runpy.run_module("canipulator", run_name="__main__", alter_sys=True)
