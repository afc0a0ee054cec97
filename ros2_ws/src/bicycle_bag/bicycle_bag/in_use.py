"""Keeps a repair off a bag that another process records or repairs.

A recorder holds a lock (`flock`) on the file that it writes, a repair one on the folder and on a
file that it was given. The kernel releases them however a process ends. Programs that take no lock
are found by the files that they have open for writing.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from bicycle_bag.errors import BagError

FILES = "*.mcap", "*.db3"
"""Files of a bag that a recorder writes."""
_PROCESSES = Path("/proc")


def claim(descriptor: int, shared: bool = False) -> bool:
    """Lock an open file or folder until it is closed.

    Args:
        descriptor: Of the file.
        shared: Let others lock it in this way, too.

    Returns:
        False if another process has locked it. A file system without locks refuses nobody.
    """
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
    return True


@contextlib.contextmanager
def held(path: Path) -> Iterator[None]:
    """Keep others from repairing a bag while the context lasts.

    Args:
        path: Bag directory or file; if there is none, nothing is held.

    Raises:
        BagError: Another process records or repairs it.
    """
    with contextlib.ExitStack() as stack:
        try:
            is_folder = path.is_dir()
            if is_folder or path.is_file():
                folder = _opened(stack, path if is_folder else path.parent)
                if folder >= 0 and not claim(folder, shared=not is_folder):
                    raise BagError(_being_repaired(path, folder))
                files = [file for kind in FILES for file in path.glob(kind)]
                _refuse_writers(path, files if is_folder else [path])
                if not is_folder:
                    _claim_file(stack, path)
        except (OSError, ValueError):  # the repair itself says what is wrong with the path
            pass
        yield


def _opened(stack: contextlib.ExitStack, path: Path) -> int:
    """Return a descriptor for as long as the stack lasts; -1 if the path cannot be opened."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return -1
    stack.callback(os.close, descriptor)
    return descriptor


def _claim_file(stack: contextlib.ExitStack, path: Path) -> None:
    descriptor = _opened(stack, path)
    if descriptor >= 0 and not claim(descriptor):
        raise BagError(_being_repaired(path, descriptor))


def _refuse_writers(path: Path, files: list[Path]) -> None:
    """Refuse a bag with a file that is locked by its recorder, or open for writing elsewhere."""
    wanted = set()
    for file in files:
        with contextlib.suppress(OSError):  # a link to nowhere
            about = file.stat()
            wanted.add((about.st_dev, about.st_ino))
    for place, process in _writers() if wanted else ():
        if place in wanted:
            raise BagError(_being_written(path, process))
    for file in files:
        with contextlib.ExitStack() as stack:
            descriptor = _opened(stack, file)
            if descriptor >= 0 and not claim(descriptor):
                raise BagError(
                    f"{path} is being written or repaired by {_holder(descriptor)}: wait until "
                    "that has ended, or end it (Ctrl-C, stop.sh), then try again"
                )


def _writers() -> Iterator[tuple[tuple[int, int], int]]:
    """Yield device and inode of each file that another process has open for writing, and who."""
    for process in _PROCESSES.glob("[0-9]*"):
        if int(process.name) == os.getpid():
            continue
        try:
            descriptors = list((process / "fd").iterdir())
        except OSError:  # it has ended, or is another user's
            continue
        for number in descriptors:
            with contextlib.suppress(OSError, ValueError, IndexError):
                about = number.stat()
                information = (process / "fdinfo" / number.name).read_text()
                flags = int(information.partition("flags:")[2].split()[0], 8)
                if flags & os.O_ACCMODE != os.O_RDONLY:
                    yield (about.st_dev, about.st_ino), int(process.name)


def _holder(descriptor: int) -> str:
    """Return who has locked a file, as far as the kernel says."""
    about = os.fstat(descriptor)
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in (_PROCESSES / "locks").read_text().splitlines():
            words = line.split()
            if words[1] == "FLOCK" and words[5].endswith(f":{about.st_ino}") and int(words[4]) > 0:
                return _named(int(words[4]))
    return "another process"


def _named(process: int) -> str:
    with contextlib.suppress(OSError):
        name = (_PROCESSES / str(process) / "comm").read_text().strip()
        return f"process {process} ({name})"
    return f"process {process}"


def _being_written(path: Path, process: int) -> str:
    return (
        f"{path} is being written by {_named(process)}: end that first (Ctrl-C in its terminal, "
        "stop.sh), then repair the bag if it still needs it"
    )


def _being_repaired(path: Path, descriptor: int) -> str:
    return f"{path} is being repaired by {_holder(descriptor)}: wait until that has ended"
