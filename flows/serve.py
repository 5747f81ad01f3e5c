"""`upplied serve`: Prefect's server with the deployments, a worker and the fleet's pages, until Ctrl-C.

For a desk; systemd or compose start the parts (`only`) for months (docs/operating.md).
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Literal

import psutil

from . import environment as env
from . import server as service
from .server import PRIVATE, Server, ServerError, start, stop, waited_for

Part = Literal["server", "worker", "reports"]
# What whoever serves may say of Prefect himself; all else that the environment says is somebody else's.
OF_CLIENT = ("PREFECT_API_AUTH_STRING",)
OF_SERVER = ("PREFECT_SERVER_API_AUTH_STRING", "PREFECT_API_DATABASE_CONNECTION_URL")
SOCKET = "UPPLIED_SOCKET"  # of the pages: a file that is bound to their port
POOL = "local"  # of the runs that a part of the service works on


def serve(port: int, roots: Sequence[str] = ()) -> int:
    """Start what a fleet needs, in the order it needs it, and stop it again in the reverse.

    The pages are on the next port, or on any where that is taken; port 0 is any, too. Runs may use `roots`
    besides this folder.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # through the same exits as Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by what a script started with &
    try:
        with ExitStack() as stack:
            server = stack.enter_context(Server(env.prefect_home(), port))
            server.wait()
            deploy(server.environment)
            try:
                pages = socket.create_server(("127.0.0.1", server.port + 1))
            except OSError:
                pages = socket.create_server(("127.0.0.1", 0))
            with pages:  # the port is held for who answers there
                own, variables = pages.getsockname()[1], server.environment | {SOCKET: str(pages.fileno())}
                words = ("upplied", "serve", "--only", "reports", "--port", str(own - 1))
                shown = start(*words, environment=variables, holding=[pages])
            stack.callback(stop, shown)
            address = f"http://127.0.0.1:{own}"
            of_worker = server.environment | {env.ADDRESS: address, env.ROOTS: ",".join(declared(roots))}
            worker = start("prefect", "worker", "start", "--pool", POOL, environment=of_worker)
            runs: list[psutil.Process] = []
            stack.callback(stop, worker, known=runs)
            say(f"Fleet:    {address}")
            say(f"Prefect:  http://127.0.0.1:{server.port}   (user {server.password.partition(':')[0]})")
            say(f"Password: stored in {env.prefect_home() / env.PASSWORD}, which only you can read")
            say("Run now:  upplied fleet run        Stop: Ctrl-C")
            attend({"server": server.process, "worker": worker, "pages": shown}, server.log, runs)
    except ServerError as error:
        say(str(error))
        return 1
    except KeyboardInterrupt:
        return 0
    return 1


def only(part: Part, port: int, roots: Sequence[str] = ()) -> int:
    """Become one part of the service, for a supervisor that starts it again when it ends."""
    api_url = os.environ.get("PREFECT_API_URL") or f"http://127.0.0.1:{port}/api"
    folder, bind = env.prefect_home(), os.environ.get("UPPLIED_BIND", "127.0.0.1")
    if part == "reports":
        from upplied.catalog import open_catalog
        from upplied.web import serving
        from upplied.web.guard import Login, allowed_names

        catalog = open_catalog(os.environ.get("UPPLIED_CATALOG") or env.home() / "catalog")
        say(f"Fleet: http://127.0.0.1:{port + 1}")
        bound = int(os.environ.get(SOCKET, "-1"))
        login = Login(password_of(folder))
        serving.Server(catalog, port + 1, bind, login, allowed_names(), bound).run()
    elif part == "server":
        folder.mkdir(parents=True, exist_ok=True)
        lock = service.alone(folder)
        os.set_inheritable(lock.fileno(), True)
        os.umask(PRIVATE)
        env.sign_in(folder, f"http://127.0.0.1:{port}/api")
        variables = env.environment(folder, api_url) | service.address(port) | passed_on(*OF_SERVER)
        become(service.command("--host", bind, "--port", str(port)), variables)
    else:
        variables = env.environment(folder, api_url) | passed_on(*OF_CLIENT)
        if not waited_for(lambda: service.answers(api_url)):
            raise ServerError(f"no Prefect server answers at {api_url}")
        deploy(variables)
        variables |= {env.ROOTS: ",".join(declared(roots))}
        variables.setdefault(env.ADDRESS, f"http://127.0.0.1:{port + 1}")
        become(("prefect", "worker", "start", "--pool", POOL), variables)
    return 0


def password_of(folder: Path) -> str:
    """The password of the service: the environment's, else the one that its server stores when it starts."""
    password = waited_for(lambda: os.environ.get(OF_CLIENT[0]) or env.profile(folder).get(OF_CLIENT[0]))
    if not password:
        raise ServerError(f"no password in {folder}: start the server first (upplied serve --only server)")
    return password


def become(words: Sequence[str], variables: dict[str, str]) -> None:
    """This process goes on as a module of Python's."""
    os.chdir(env.home())
    os.execve(sys.executable, [sys.executable, "-m", *words], variables)


def passed_on(*names: str) -> dict[str, str]:
    """Those of the named variables that are set."""
    return {name: os.environ[name] for name in names if name in os.environ}


def declared(roots: Sequence[str]) -> list[str]:
    """Where runs may read and write: this folder, and what was declared."""
    return list(dict.fromkeys([str(env.home()), *env.named_roots(), *roots]))


def deploy(variables: dict[str, str]) -> None:
    """The work pools, the deployments of prefect.yaml, and what Prefect does by itself."""
    words = [sys.executable, "-m", f"{__package__}.automations", str(env.carried("prefect.yaml"))]
    child = subprocess.run(words, env=variables, cwd=env.home(), check=False, capture_output=True, text=True)
    if child.returncode:
        raise ServerError(f"the deployments were not made:\n{child.stdout}{child.stderr}")


def attend(processes: Mapping[str, subprocess.Popen[bytes]], log: Path, runs: list[psutil.Process]) -> None:
    """Wait until one of the processes, by name, ends: a `ServerError`; whoever started the others stops them.

    `runs` receives what the worker started, which cannot be found once it was killed.
    """
    while True:
        for name, process in processes.items():
            code = process.poll()
            if code is not None:
                where = f"; its log is {log}" if name == "server" else ""
                raise ServerError(f"the {name} ended with code {code}{where}")
        if now := service.offspring(processes["worker"].pid):
            runs[:] = now
        time.sleep(0.5)


def say(text: str) -> None:
    """A line for the operator."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
