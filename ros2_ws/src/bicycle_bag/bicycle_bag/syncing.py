"""Syncs written data in separate threads, so that a slow disk does not block the recorder."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path


def sync_folder(folder: Path) -> None:
    """Hand the names of a folder's files to the disk: a file that was renamed stays so.

    Raises:
        OSError: The disk does not take them.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Syncer:
    """Syncs one file when it is asked to, beside the thread that writes it.

    A sync took 0.25 s on a busy virtual disk, and much longer is possible. Done by the writing
    thread it would keep messages out of the file for so long, and a killed process would lose
    them; a process that has only asked for it has given its data to the kernel already.

    Attributes:
        slowest: s, longest sync so far.
    """

    def __init__(self, descriptor: int) -> None:
        """Prepare to sync the file of this descriptor, which must stay open until `wait`."""
        self.slowest = 0.0
        self._descriptor = descriptor
        self._asked = threading.Condition()
        self._wanted = self._ending = False
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="sync", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Have all that is written so far synced soon.

        Raises:
            OSError: An earlier sync has failed.
        """
        self._raise()
        with self._asked:
            self._wanted = True
            self._asked.notify()

    def end(self) -> None:
        """Have all that is written synced a last time, with the file's size and times, and end."""
        with self._asked:
            self._ending = True
            self._asked.notify()

    def wait(self) -> None:
        """Wait for the last sync, which `end` has asked for.

        Raises:
            OSError: A sync has failed.
        """
        self._thread.join()
        self._raise()

    @property
    def ended(self) -> bool:
        """True if there is nothing to wait for: the last sync is done, or one has failed."""
        return not self._thread.is_alive()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        last = False
        while not last:
            with self._asked:
                self._asked.wait_for(lambda: self._wanted or self._ending)
                last, self._wanted = self._ending, False
            began = time.monotonic()
            try:
                if last:
                    os.fsync(self._descriptor)
                else:
                    os.fdatasync(self._descriptor)
            except OSError as error:
                self._error = error
                return
            self.slowest = max(self.slowest, time.monotonic() - began)
