"""Ports of 127.0.0.1 for what must be told its port before it starts, or start on the same one again."""

from __future__ import annotations

import fcntl
import random
import socket
import tempfile
from pathlib import Path
from typing import IO

_locks: list[IO[bytes]] = []  # held until this process ends


def free_port() -> int:
    """A port that is this process's own, as is the next one.

    The kernel gives nobody a port below its range unasked, and tests of other processes leave a port alone
    whose file is locked.
    """
    first = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    while True:
        port = random.SystemRandom().randrange(10_000, min(first, 32_768) - 1, 2)
        lock = (Path(tempfile.gettempdir()) / f"upplied-port-{port}").open("ab")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for number in (port, port + 1):
                socket.create_server(("127.0.0.1", number)).close()
        except OSError:
            lock.close()
            continue
        _locks.append(lock)
        return port
