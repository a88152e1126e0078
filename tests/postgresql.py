"""A real PostgreSQL server for tests: on loopback, in a temporary folder, never as root; only where it is installed."""

import os
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg

from distalock.local_ports import free_ports

PATIENCE_S = 60.0
_INSTALLED = Path("/usr/lib/postgresql")


def why_not_installed() -> str | None:
    """Why there can be no server here, for a test that is skipped; None when there can."""
    if _programs() is None:
        return f"PostgreSQL's server is not installed in {_INSTALLED} (Debian's package postgresql)"
    if os.geteuid() == 0 and _owner() is None:
        return "PostgreSQL refuses to run as root, and there is no user postgres"
    return None


def _programs() -> Path | None:
    return next((f.parent for f in sorted(_INSTALLED.glob("*/bin/initdb"), reverse=True)), None)


def _owner() -> str | None:
    """Who the server runs as, when that cannot be the user of the tests."""
    if os.geteuid() != 0:
        return None
    return next((user.pw_name for user in pwd.getpwall() if user.pw_name == "postgres"), None)


class Server:
    """A server that can be killed and started again on what it left behind."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._password = secrets.token_hex(16)
        self._process: subprocess.Popen[bytes] | None = None
        (self.port,) = free_ports(1)
        secret = folder / "password"
        secret.write_text(self._password)
        if (owner := _owner()) is not None:
            for path in (folder, secret):
                shutil.chown(path, owner)
        arguments = (
            "--no-sync",
            "--username=distalock",
            "--auth=scram-sha-256",
            f"--pwfile={secret}",
            "--encoding=UTF8",
        )
        with self._run("initdb", *arguments, "--pgdata", str(folder / "data")) as made:
            assert made.wait() == 0, (folder / "log").read_text()

    def url(self, database: str = "postgres") -> str:
        return f"postgresql://distalock:{self._password}@127.0.0.1:{self.port}/{database}"

    def start(self) -> None:
        # A killed process loses nothing that it gave to the system: flushing to the disk would only take time here.
        settings = (
            "fsync=off",
            "full_page_writes=off",
            "autovacuum=off",
            "listen_addresses=127.0.0.1",
            f"port={self.port}",
            "unix_socket_directories=",
        )
        self._process = self._run(
            "postgres", "-D", str(self._folder / "data"), *(w for s in settings for w in ("-c", s))
        )
        for _ in range(int(PATIENCE_S / 0.05)):
            try:
                psycopg.connect(self.url(), connect_timeout=5).close()
            except psycopg.OperationalError:
                assert self._process.poll() is None, (self._folder / "log").read_text()
                with socket.socket() as pause:  # nothing tells when it is ready
                    pause.settimeout(0.05)
                    pause.bind(("127.0.0.1", 0))
                    pause.listen()
                    try:
                        pause.accept()
                    except TimeoutError:
                        continue
            return
        raise AssertionError("PostgreSQL did not start: " + (self._folder / "log").read_text())

    def end(self, how: signal.Signals) -> None:
        """SIGINT: in order; SIGQUIT: at once with all its processes, as if it had crashed."""
        assert self._process is not None
        self._process.send_signal(how)
        self._process.wait(PATIENCE_S)

    def make_database(self, template: str = "template0") -> str:
        """A new database; its name."""
        name = f"test_{secrets.token_hex(6)}"
        with psycopg.connect(self.url(), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name} TEMPLATE {template}")
        return name

    def _run(self, program: str, *arguments: str) -> "subprocess.Popen[bytes]":
        programs = _programs()
        assert programs is not None
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen(
                [programs / program, *arguments], stdout=log, stderr=log, cwd=self._folder, user=_owner()
            )


@contextmanager
def running_server() -> Iterator[Server]:
    """A server with a folder of its own, both gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="distalock-postgresql-") as folder:
        server = Server(Path(folder))
        server.start()
        try:
            yield server
        finally:
            server.end(signal.SIGQUIT)
