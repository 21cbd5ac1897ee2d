"""`daranti panel`: the operator's page, served to a phone and a laptop.

The server knows nothing of driving: it passes the pages' wishes to the machine's process and that
process's snapshots to the pages. A page that does not keep up misses snapshots, never delays one.

    GET  /                the page              GET /static/NAME   its parts
    POST /pair            {"code": ...}         POST /stop?id=...  the way round a broken socket
    WS   /live            snapshots and pictures out, wishes in
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import json
import math
import time
from collections.abc import AsyncIterator, Callable
from importlib import resources
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from host.core.messages import Fix
from host.core.vehicle_file import load_vehicle, mount_of
from host.panel.board import MachineLine
from host.panel.body import BodyError, json_body
from host.panel.colours import ColourDesk
from host.panel.fields import FieldDesk
from host.panel.gate import Guard
from host.panel.guard import Pairing, Seat
from host.panel.machine import Settings
from host.panel.snapshot import Json, fix_of

TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}
COOKIE: Final = "daranti"
PAGES: Final = 12
WISHES_A_SECOND: Final = 40
"""Of one page; more are refused."""
HOLD_S: Final = 2.0
"""How long start has to be held."""
HOLD_SLACK_S: Final = 0.3
"""The page counts its own two seconds; the network may bring their ends a little closer."""
CHECK_HOLDS_S: Final = 12 * 3600.0
"""How long a check that was green holds: a working day."""
LATE_S: Final = 2.0
"""Seconds between a state and what a page asks on the sight of it. What comes later was asked of
another situation: a flaky Wi-Fi keeps a tap and hands it over when nobody expects it any more."""
IN_SIGHT: Final = frozenset(
    {"here", "hold", "start", "go_on", "clear", "jog", "check", "answer", "pid"}
)
"""Wishes by which something moves or goes on moving: only of a page that sees how things stand."""
SILENT_S: Final = 1.5
"""Seconds without a word of the machine's process, after which the pages are told so."""
STOP_ID: Final = 40
"""Letters of the name that a page gives to its STOP: all pages are told it five times a second."""
TOLD_ONCE: Final = 50
"""Letters that wait for a page that does not keep up; the oldest are lost."""
STATES: Final = frozenset({"plan", "ended", "check", "goal", "field"})
"""Kinds of which only the newest message counts."""
FIELD_WISHES: Final = frozenset(
    {"open", "gap", "corner", "move_corner", "keep_out", "keep_out_drop"}
    | {"add_corner", "drop_corner"}
    | {"walk_begin", "walk_end", "walk_drop", "form"}
)
PLACED: Final = ("field", "harvest")
"""Pages with a map that shows where the phone is."""
CODE_EVERY_S: Final = 0.5
"""Between looks for a new code."""
RUNS: Final = 20
"""Shown in the list of past runs, the latest."""


class Page:
    """One open page. Of snapshots and pictures it gets the newest that its socket takes."""

    def __init__(self, socket: WebSocket, name: str) -> None:
        self.socket = socket
        self.name = name
        self.wants_picture = False
        self.tab = ""
        self.held_since: float | None = None
        self._letters: list[Json] = []
        self._newest: Json | None = None
        self._picture: bytes | None = None
        self._wake = asyncio.Event()
        self._allowance = float(WISHES_A_SECOND)
        self._counted = time.monotonic()

    def tell(self, message: Json) -> None:
        """Something that is not repeated. A page that sleeps for long finds nothing missing: of a
        state it gets the newest, of the trail all."""
        kind, letters = message.get("kind"), self._letters
        if kind in STATES:
            letters = [one for one in letters if one.get("kind") != kind]
        if kind == "plan" and not message["anew"]:
            letters = [one for one in letters if one.get("kind") != "trail"]
        if kind == "trail":
            waiting = [one for one in letters if one.get("kind") == "trail"]
            letters = [one for one in letters if one.get("kind") != "trail"]
            if waiting and not message["all"]:
                places = waiting[0]["places"] + message["places"]
                message = waiting[0] | {"places": places}
        letters.append(message)
        once = [one for one in letters if one.get("kind") not in STATES | {"trail"}]
        for lost in once[:-TOLD_ONCE]:
            letters.remove(lost)
        self._letters = letters
        self._wake.set()

    def show(self, message: Json) -> None:
        """A snapshot; a newer one takes its place."""
        self._newest = message
        self._wake.set()

    def show_picture(self, jpeg: bytes) -> None:
        """Likewise."""
        if self.wants_picture:
            self._picture = jpeg
            self._wake.set()

    def too_many(self) -> bool:
        """Whether the page asks faster than any finger."""
        now = time.monotonic()
        self._allowance = min(
            float(WISHES_A_SECOND), self._allowance + (now - self._counted) * WISHES_A_SECOND
        )
        self._counted = now
        self._allowance -= 1
        return self._allowance < 0

    async def write(self) -> None:
        """Until the socket closes."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._letters:
                await self.socket.send_text(json.dumps(self._letters.pop(0)))
            newest, self._newest = self._newest, None
            if newest is not None:
                await self.socket.send_text(json.dumps(newest))
            picture, self._picture = self._picture, None
            if picture is not None:
                await self.socket.send_bytes(picture)


class Panel:
    """What all pages share."""

    def __init__(
        self,
        settings: Settings,
        pairing: Pairing,
        fields: FieldDesk,
        show_code: Callable[[str, float], None] = lambda _code, _wait_s: None,
    ) -> None:
        """`show_code` shows the laptop's operator each new code that pairs, and for how many
        seconds nobody pairs because there were too many wrong ones."""
        self.settings = settings
        self._show_code = show_code
        self.fields = fields
        self.pairing = pairing
        self.seat = Seat(time.monotonic)
        self.pages: dict[str, Page] = {}
        self.line = MachineLine(settings, self._heard, self._pictured)
        self.now: Json = {}
        self._said_now = time.monotonic()
        """When the machine's process last said how things stand,"""
        self._drove = False
        """and whether it drove then."""
        self.plan: Json | None = None
        self.trail: list[Any] = []
        self.ended: Json | None = None
        self.check: Json | None = None
        self.goal: Json | None = None
        self._goals = 0
        """How many were looked for."""
        self.field: Json | None = None
        self._count = 0
        vehicle = load_vehicle(settings.vehicle)
        mount = mount_of(vehicle, settings.mount)
        self.colours = ColourDesk(vehicle, mount, settings.mount)
        self.jpeg: bytes | None = None
        self._colour_busy = False
        self._fix_stamp = -1.0
        self._work = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    def begin(self) -> None:
        """Once the loop runs: what is known of the field, and of a run that a crash ended."""
        self._later(None)

        self._keep_task(asyncio.create_task(self._look_back(crashed=False)))
        self._keep_task(asyncio.create_task(self._watch_machine()))
        if self.pairing.needed:
            self._keep_task(asyncio.create_task(self._show_codes()))

    async def _look_back(self, *, crashed: bool) -> None:
        """What a run left that a crash ended: of the laptop, or (`crashed`) of the machine's
        process just now."""
        async with self._work:
            left = await asyncio.to_thread(self.fields.unfinished)
        if left is not None and (crashed or self.ended is None):
            self._heard({"kind": "ended", "outcome": "stopped", "resume": str(left)})

    async def _watch_machine(self) -> None:
        """While the machine's process says nothing, the pages are told that, in place of how things
        stood."""
        while True:
            await asyncio.sleep(SILENT_S / 3)
            if time.monotonic() - self._said_now < SILENT_S:
                continue
            self.now = {}
            if not self.line.connected:
                self._note_crash()
            for page in self.pages.values():
                page.show({"kind": "alone", "why": self.line.problem})

    def _note_crash(self) -> None:
        """The machine's process has ended: a run that went on in it can be gone on with."""
        if self._drove:
            self._drove = False
            self._keep_task(asyncio.create_task(self._look_back(crashed=True)))

    async def _show_codes(self) -> None:
        """A code pairs one phone, ends with wrong guesses and grows old: whoever holds the next
        phone needs the next one. A terminal that is halted halts nobody else."""
        shown = ""
        while True:
            code = self.pairing.code
            if code != shown:
                shown = code
                await asyncio.to_thread(self._show_code, code, self.pairing.wait_s)
            await asyncio.sleep(CODE_EVERY_S)

    async def end(self) -> None:
        """Ends what `begin` began."""
        for task in self._tasks:
            task.cancel()

    # ---- from the machine ------------------------------------------------------------------------

    def _heard(self, message: Json) -> None:
        kind = message.get("kind")
        if kind == "now":
            if message["t"] < self.now.get("t", -math.inf):  # another process began its clock anew
                self._note_crash()
            self._drove = message["mode"] == "drive"
            self.now, self._said_now = message, time.monotonic()
            self._hear_fix(message)
            for page in self.pages.values():
                page.show(self._for(page))
            return
        match kind:
            case "plan":
                self.plan = message
                if not message["anew"]:
                    self.trail = []
            case "trail":
                before = [] if message["all"] else self.trail
                self.trail = before + message["places"]
            case "ended":
                self.ended = message
                self._find_goal(message.get("resume"))
            case "check":
                self.check = message | {"at": time.monotonic()}
        for page in self.pages.values():
            page.tell(message)

    def _hear_fix(self, message: Json) -> None:
        """A new position: the walk's next step, and where the phone is on the map."""
        found = message["gnss"]["fix"]
        if found is None or found["stamp"] == self._fix_stamp or found["quality"] == 0:
            return
        self._fix_stamp = found["stamp"]
        fix = fix_of(found)
        walk = self.fields.walk
        if walk is not None and walk.on:
            walk.fixes.append(fix)
        if message["mode"] == "idle" and any(page.tab in PLACED for page in self.pages.values()):
            self._later(None, fix)

    def _later(self, wish: Json | None, fix: Fix | None = None) -> None:
        """Field work in a thread, one piece after the other, and its outcome to all pages."""

        async def work() -> None:
            async with self._work:
                if wish is not None:
                    await asyncio.to_thread(self.fields.do, wish)
                before = self.field or {}
                self.field = await asyncio.to_thread(self.fields.about, fix)
                changed = wish is not None and before.get("plan") != self.field["plan"]
                if changed and self.now.get("mode") == "idle":
                    self._forget_the_run()
            for page in self.pages.values():
                page.tell(self.field)

        if fix is not None and self._work.locked():
            return
        self._keep_task(asyncio.create_task(work()))

    def _forget_the_run(self) -> None:
        """The map shows another plan now, and where a run that ended goes on is told by it."""
        self._heard({"kind": "plan", "boundary": [], "anew": False})
        self._find_goal((self.ended or {}).get("resume"))

    def _find_goal(self, resume: str | None) -> None:
        """Where the machine has to stand to go on, to all pages. Until it is found, the place of an
        earlier run is none."""

        self._goals += 1
        asked = self._goals

        def tell(goal: Json) -> None:
            if asked != self._goals:  # another is looked for by now
                return
            self.goal = goal
            for page in self.pages.values():
                page.tell(goal)

        async def work() -> None:
            found = None
            if resume is not None:
                async with self._work:
                    found = await asyncio.to_thread(self.fields.goal, Path(resume))
            tell(found or {"kind": "goal", "place": None, "stuck": resume is not None})

        tell({"kind": "goal", "place": None, "stuck": False})
        self._keep_task(asyncio.create_task(work()))

    def _keep_task(self, task: asyncio.Task[None]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _colour(self, page: Page, wish: Json) -> None:
        """One move of the sliders; while one is worked on, further looks are left out."""
        if self._colour_busy and wish.get("do") == "colour_look":
            return

        async def work() -> None:
            self._colour_busy = True
            try:
                page.tell(await asyncio.to_thread(self.colours.do, wish, self.jpeg))
            finally:
                self._colour_busy = False

        self._keep_task(asyncio.create_task(work()))

    def _for(self, page: Page) -> Json:
        return self.now | {
            "driver": self.seat.holder == page.name,
            "driven": self.seat.taken,
            "pages": len(self.pages),
            "green": self.green,
        }

    def _pictured(self, jpeg: bytes) -> None:
        self.jpeg = jpeg
        for page in self.pages.values():
            page.show_picture(jpeg)

    @property
    def green(self) -> bool:
        """Whether the last check lets the machine start."""
        check = self.check
        return (
            check is not None
            and bool(check.get("green"))
            and time.monotonic() - check["at"] < CHECK_HOLDS_S
        )

    # ---- from a page -----------------------------------------------------------------------------

    async def live(self, socket: WebSocket) -> None:
        """One page's WebSocket, from its opening to its end."""
        if not self.pairing.known(socket.cookies.get(COOKIE)):
            await socket.close(4401)
            return
        if len(self.pages) >= PAGES:
            await socket.close(4429)
            return
        await socket.accept()
        self._count += 1
        page = Page(socket, f"page-{self._count}")
        self.pages[page.name] = page
        for message in (self.plan, self._trail(), self.check, self.ended, self.goal, self.field):
            if message is not None:
                page.tell(message)
        if self.now:
            page.show(self._for(page))
        writer = asyncio.create_task(page.write())
        try:
            while True:
                self._wish(page, await socket.receive_text())
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            writer.cancel()
            del self.pages[page.name]
            self.seat.leave(page.name)
            with contextlib.suppress(RuntimeError):
                await socket.close()

    def _trail(self) -> Json:
        return {"kind": "trail", "places": self.trail, "all": True}

    def _wish(self, page: Page, text: str) -> None:
        """One message of a page; what makes no sense is ignored."""
        try:
            wish = json.loads(text)
            json.dumps(wish, allow_nan=False)  # what cannot be passed on
        except (ValueError, RecursionError):
            return
        what = wish.get("do") if isinstance(wish, dict) else None
        if not isinstance(what, str):
            return
        if what == "stop":
            self.stop(page, wish)
            return
        if page.too_many():
            return
        if what == "look":
            page.wants_picture = bool(wish.get("picture"))
            page.tab = str(wish.get("page"))[:20]
            if page.tab == "field":
                self._later(None)
        elif what == "take":
            if not self.seat.take(page.name):
                page.tell({"kind": "refused", "what": "take"})
        elif what == "runs":
            page.tell({"kind": "runs", "runs": runs(self.settings.folder)})
        elif what == "hello":
            pass
        elif what == "leave":
            self.seat.leave(page.name)
        elif self.seat.holder != page.name:
            if what != "here":
                page.tell({"kind": "refused", "what": "watching"})
        elif what in IN_SIGHT and not self._in_sight(wish.get("seen")):
            if what != "here":
                page.tell({"kind": "refused", "what": "late"})
        else:
            self._drivers(page, wish)

    def _in_sight(self, seen: object) -> bool:
        """Whether a page that has `seen` the state of that time, by the machine's clock, has seen
        how things stand now."""
        t = self.now.get("t")
        return (
            isinstance(t, int | float) and isinstance(seen, int | float) and 0 <= t - seen <= LATE_S
        )

    def _drivers(self, page: Page, wish: Json) -> None:
        """Wishes of the page that drives."""
        match wish.get("do"):
            case "here":
                self.seat.hear(page.name)
                self.line.ask({"do": "here"})
            case "hold":
                page.held_since = time.monotonic()
            case "let_go":
                page.held_since = None
            case "start":
                self._start(page, wish)
            case "pause" | "go_on" | "clear" | "jog" | "jog_end" | "answer" | "pid":
                self.line.ask(wish)
            case "check":
                self.line.ask({"do": "check", "order": self.order()})
            case "colour_begin" | "colour_take" | "colour_look" | "colour_best" | "colour_save":
                self._colour(page, wish)
            case what if what in FIELD_WISHES:
                self._later(wish)
            case _:
                pass

    def _start(self, page: Page, wish: Json) -> None:
        held, page.held_since = page.held_since, None
        resume = (self.ended or {}).get("resume") if wish.get("resume") else None
        heading = wish.get("heading_deg")
        if held is None or time.monotonic() - held < HOLD_S - HOLD_SLACK_S:
            page.tell({"kind": "refused", "what": "hold"})
        elif not self.green:
            page.tell({"kind": "refused", "what": "check"})
        elif wish.get("resume") and resume is None:
            page.tell({"kind": "refused", "what": "resume"})
        elif heading is not None and not (isinstance(heading, int | float) and 0 <= heading <= 360):
            page.tell({"kind": "refused", "what": "heading"})
        else:
            order = self.order() | {"resume": resume, "heading_deg": heading}
            self.line.ask({"do": "start", "order": order})

    def order(self) -> Json:
        """Which field, from where."""
        path = self.fields.path
        return {
            "boundary": None if path is None else str(path),
            "gap_m": self.fields.gap_m,
            "inset_m": self.fields.inset_m,
            "corner": self.fields.corner,
        }

    def stop(self, page: Page | None, wish: Json) -> bool:
        """To the machine, first of all; the page learns at once if there is nobody to tell. A
        finger that holds the start button meanwhile starts nothing."""
        name = wish.get("id")
        name = name[:STOP_ID] if isinstance(name, str) else None
        reached = self.line.ask({"do": "stop", "id": name})
        for one in self.pages.values():
            one.held_since = None
        if not reached and page is not None:
            page.tell({"kind": "refused", "what": "stop"})
        return reached


class Run(BaseModel):
    """What the page says of a past run. A file that says less is no run's."""

    outcome: Literal["finished", "stopped", "fault"]
    reason: str = ""
    code: str = ""
    words: Json = {}
    faults: list[str]
    record: str
    turns: int
    pictures: int
    slow_steps: int
    late_steps: int
    seconds: float


def runs(folder: Path) -> list[Json]:
    """The last runs, newest first, as they ended."""
    found = []
    for path in sorted(folder.glob("drive-*.run.json"), reverse=True):
        with contextlib.suppress(OSError, ValueError):
            begun = datetime.datetime.strptime(path.name[6:21], "%Y%m%d-%H%M%S")
            run = Run.model_validate_json(path.read_bytes())
            found.append(run.model_dump() | {"begun": f"{begun:%Y-%m-%dT%H:%MZ}"})
        if len(found) == RUNS:
            break
    return found


def _parts() -> dict[str, bytes]:
    """The page and its parts, by the path that a browser asks for."""
    folder = resources.files("host.panel")
    files = {"": folder / "static" / "index.html"}
    for room in ("static", "texts"):
        files |= {f"{room}/{one.name}": one for one in (folder / room).iterdir() if one.is_file()}
    return {name: file.read_bytes() for name, file in files.items()}


class Web:
    """What answers a browser."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._parts = _parts()

    def _known(self, request: Request) -> bool:
        return self._panel.pairing.known(request.cookies.get(COOKIE))

    async def static(self, request: Request) -> Response:
        """The page and its parts."""
        name = request.path_params.get("name", "")
        content = self._parts.get(name)
        if content is None:
            return Response("not served here", 404)
        suffix = ".html" if name == "" else name[name.rindex(".") :]
        return Response(content, headers={"content-type": TYPES.get(suffix, "text/plain")})

    async def pair(self, request: Request) -> Response:
        """The code for a ticket, which the browser keeps."""
        body: Json = {}
        with contextlib.suppress(BodyError):
            body = await json_body(request)
        pairing = self._panel.pairing
        if pairing.wait_s > 0:
            return JSONResponse({"wait_s": round(pairing.wait_s)}, 429)
        ticket = pairing.pair(str(body.get("code", "")))
        if ticket is None:
            return JSONResponse({"wrong": True, "wait_s": round(pairing.wait_s)}, 403)
        answer = JSONResponse({"paired": True})
        answer.set_cookie(COOKIE, ticket, max_age=30 * 86400, httponly=True, samesite="strict")
        return answer

    async def paired(self, request: Request) -> Response:
        """Whether this browser has a ticket."""
        return JSONResponse({"paired": self._known(request)})

    async def stop(self, request: Request) -> Response:
        """STOP without a socket; no body is waited for. A page whose script has not come sends its
        form, and wants the page again."""
        if not self._known(request):
            return JSONResponse({"paired": False}, 401)
        reached = self._panel.stop(None, {"id": request.query_params.get("id")})
        script = request.headers.get("content-type", "").startswith("application/json")
        if reached and not script:
            return Response(status_code=303, headers={"location": "/"})
        return JSONResponse({"reached": reached}, 200 if reached else 503)

    @contextlib.asynccontextmanager
    async def lifespan(self, _: Starlette) -> AsyncIterator[None]:
        """Listens to the machine for as long as it is served."""
        task = asyncio.create_task(self._panel.line.run())
        self._panel.begin()
        try:
            yield
        finally:
            task.cancel()
            await self._panel.end()
            await asyncio.to_thread(self._panel.line.end)


def application(panel: Panel) -> ASGIApp:
    """The ASGI application."""
    web = Web(panel)
    app = Starlette(
        routes=[
            Route("/", web.static),
            Route("/paired", web.paired),
            Route("/pair", web.pair, methods=["POST"]),
            Route("/stop", web.stop, methods=["POST"]),
            WebSocketRoute("/live", panel.live),
            Route("/{name:path}", web.static),
        ],
        lifespan=web.lifespan,
    )
    return Guard(app)
