"""The server of the page: NiceGUI behind a guard that admits only this machine's own page."""
from __future__ import annotations

import asyncio
import contextlib
import gc
import secrets
import socket
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from nicegui import app, background_tasks, core, ui
from nicegui.server import Server

from beamid_studio import studio_page
from beamid_studio.session import Session

HOST = "127.0.0.1"
#: Seconds after which the server ends when its last tab is closed; reloading a tab takes less.
LINGER = 6.0
#: Seconds after which it ends when the websocket of its last tab has fallen silent without being
#: closed: the computer, or the tab, is asleep.
SLEEP = 8 * 3600.0
#: Seconds for which a page without a websocket is kept.
RECONNECT = 10.0
#: Seconds between two signs of life of a websocket, and those that an answer may take: on a busy
#: machine NiceGUI's 2 s were too few, and what the user did was lost with the websocket.
PING = (10.0, 15.0)
#: Largest body of a request that is no upload.
SMALL = 1_000_000
HEADERS = [
    (b"content-security-policy", (
        b"default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'none'; "
        b"form-action 'self'; base-uri 'self'")),
    (b"referrer-policy", b"no-referrer"), (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"), (b"cross-origin-resource-policy", b"same-origin")]


@dataclass
class Settings:
    """What the command line asks for."""

    file: Path | None    #: to open first
    folder: Path            #: below which everything is written
    port: int
    limit: int              #: bytes of an upload
    show: bool              #: whether to open a browser
    stay: bool              #: whether to continue without a tab


class Refused(Exception):
    """A request that is not answered: its status and one sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class Guard:
    """ASGI middleware in front of everything: page, files, uploads and the websocket.

    A request must name this host, come from this origin, and know the token: from the address, or
    from the cookie that the first answer sets. Bodies are limited before anything reads them.
    """

    def __init__(self, inner: Any, port: int, token: str, limit: int) -> None:
        self.inner, self.token, self.limit = inner, token, limit
        self.hosts = {f"{HOST}:{port}", f"localhost:{port}"}
        self.cookie = f"beamid_studio_{port}"

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer a request, or refuse it in one sentence."""
        if scope["type"] not in ("http", "websocket"):
            await self.inner(scope, receive, send)
            return
        try:
            new = self.check(scope)
        except Refused as refused:
            await refuse(scope, send, refused)
            return
        started = False

        async def answer(message: Any) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                more = list(HEADERS)
                if new:
                    more.append((b"set-cookie", f"{self.cookie}={self.token}; Path=/; HttpOnly; "
                                 "SameSite=Strict".encode()))
                message = {**message, "headers": [*message.get("headers", []), *more]}
            await send(message)

        received = 0

        async def take() -> Any:
            nonlocal received
            message = await receive()
            if message["type"] == "http.request":
                received += len(message.get("body", b""))
                if received > self.limit + SMALL:
                    raise Refused(413, self.too_large())
            return message

        try:
            await self.inner(scope, take, answer)
        except Refused as refused:
            if not started:
                await refuse(scope, send, refused)

    def too_large(self) -> str:
        """Return the sentence about a file that is too large."""
        return f"The file is larger than {self.limit // 10**6} MB; --limit sets the limit."

    def check(self, scope: Any) -> bool:
        """Raise Refused unless the request is one of the page; return whether its token is new."""
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        if headers.get("host", []) not in [[host] for host in self.hosts]:
            raise Refused(403, "The request names another host than this page.")
        origin = headers.get("origin", [])
        if origin and origin not in [[f"http://{host}"] for host in headers["host"]]:
            raise Refused(403, "The request comes from another page.")
        if scope["type"] == "websocket" and not origin:
            raise Refused(403, "The websocket does not say which page it comes from.")
        if headers.get("sec-fetch-site", ["none"])[0] == "cross-site" and scope["path"] != "/":
            raise Refused(403, "The request comes from another page.")
        # A path that leaves its folder is nothing that the page asks for.
        if ".." in scope["path"].replace("\\", "/").split("/") or "\0" in scope["path"]:
            raise Refused(404, "The address leads nowhere.")
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        known = self.matches(given)
        if not known and not any(map(self.matches, self.cookies(headers.get("cookie", [])))):
            raise Refused(403, "The address lacks the token that beamid studio has printed.")
        length = headers.get("content-length", ["0"])[0]
        most = self.limit if "/upload/" in scope["path"] else 0
        if not length.isdigit() or int(length) > most + SMALL:
            raise Refused(413, self.too_large())
        return known

    def matches(self, token: str) -> bool:
        """Return whether a token is that of this page, in a time that does not tell how close."""
        return secrets.compare_digest(token.encode("utf-8", "replace"), self.token.encode())

    def cookies(self, lines: list[str]) -> list[str]:
        """Return the tokens in the cookies of a request."""
        found = []
        for line in lines:
            jar: SimpleCookie = SimpleCookie()
            try:
                jar.load(line)
            except CookieError:
                continue
            found += [jar[self.cookie].value] if self.cookie in jar else []
        return found


async def refuse(scope: Any, send: Any, refused: Refused) -> None:
    """Answer with one sentence, and close the connection."""
    kind = "http.response"
    if scope["type"] == "websocket":
        if kind not in {name.removeprefix("websocket.") for name in scope.get("extensions", {})}:
            await send({"type": "websocket.close", "code": 1008, "reason": str(refused)})
            return
        kind = "websocket.http.response"
    body = f"{refused}\n".encode()
    await send({"type": f"{kind}.start", "status": refused.status, "headers": [
        (b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close"),
        (b"content-length", str(len(body)).encode()), *HEADERS]})
    await send({"type": f"{kind}.body", "body": body})


def free_port(wanted: int) -> int:
    """Return a port of this host on which nothing listens."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, wanted))
        except OSError as error:
            raise SystemExit(f"studio: port {wanted}: {error.strerror}") from None
        return int(probe.getsockname()[1])


class Tabs:
    """The tabs of the browser that are connected, and those that sleep."""

    def __init__(self, stay: bool) -> None:
        self.stay = stay
        self.open: set[str] = set()      #: clients of NiceGUI with a websocket
        self.asleep: set[str] = set()    #: clients whose websocket has fallen silent
        self.pending: asyncio.Task[None] | None = None
        self.silent = False              #: whether the websocket that is being closed is
        inner = core.sio.handlers["/"]["disconnect"]

        # NiceGUI does not say why a websocket ends: the browser has closed it, or is asleep.
        @core.sio.on("disconnect")
        def disconnecting(sid: str, reason: str) -> None:
            self.silent = reason == core.sio.reason.PING_TIMEOUT
            inner(sid)

        app.on_connect(self.connected)
        app.on_disconnect(self.disconnected)

    def connected(self, client: Any) -> None:
        """Take note of a tab."""
        self.open.add(client.id)
        self.asleep.discard(client.id)
        if self.pending:
            self.pending.cancel()

    def disconnected(self, client: Any) -> None:
        """End the server when its last tab has been closed for a while."""
        self.open.discard(client.id)
        if self.silent:
            self.asleep.add(client.id)
        if not self.open and not self.stay:
            self.pending = asyncio.get_running_loop().create_task(
                self.end(SLEEP if self.asleep else LINGER))

    async def end(self, seconds: float) -> None:
        """End the server after a while, unless a tab connects."""
        await asyncio.sleep(seconds)
        app.shutdown()


def serve(settings: Settings) -> int:
    """Serve the page until it is closed; return the exit status."""
    port, token = free_port(settings.port), secrets.token_urlsafe(24)
    app.add_middleware(Guard, port=port, token=token, limit=settings.limit)
    tabs = Tabs(settings.stay)

    @ui.page("/", title="beamid studio")
    async def page() -> None:
        client = ui.context.client
        dark = await studio_page.prepare()
        session = Session.of_tab(app.storage.tab, client.tab_id, settings.folder, settings.limit)
        tabs.asleep.discard(session.client)
        session.client = client.id
        studio = session.page = studio_page.Studio(session, dark)

        def leave() -> None:
            studio.closed = True
            session.leave(studio, client.id in tabs.asleep)
            # The parts of a page refer to one another: Python would keep several pages for long.
            asyncio.get_running_loop().call_later(1, gc.collect)

        client.on_delete(leave)
        await studio_page.build(studio, settings.file)

    app.on_shutdown(Session.close_all)

    async def tell() -> None:
        """Print the address as soon as the server listens."""
        while not Server.instance.started:
            await asyncio.sleep(0.02)
        print(f"beamid studio: http://{HOST}:{port}/?token={token}\n"
              f"It writes below {settings.folder}. Ctrl-C ends it.", flush=True)

    def be_patient() -> None:
        """Set the signs of life, for which NiceGUI has values of its own."""
        core.sio.eio.ping_interval, core.sio.eio.ping_timeout = PING

    app.on_startup(be_patient)
    app.on_startup(lambda: background_tasks.create(tell(), name="tell"))
    # Ctrl-C is the usual end, after the server has closed everything.
    with contextlib.suppress(KeyboardInterrupt):
        ui.run(host=HOST, port=port, reload=False, show_welcome_message=False,
               title="beamid studio", show=f"/?token={token}" if settings.show else False,
               dark=None, favicon="〰️", reconnect_timeout=RECONNECT, access_log=False,
               uvicorn_logging_level="warning")
    return 0
