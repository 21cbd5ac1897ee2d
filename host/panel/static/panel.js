// The page: one socket, one state, five tabs. STOP is bound before anything else can fail.
import { load, t, said, has, reason, filled, language, LANGUAGES } from "./texts.js";
import * as sound from "./sound.js";
import { drawMap, mapSaid } from "./map.js";
import { drawPicture } from "./picture.js";
import * as check from "./check.js";
import * as field from "./field.js";
import * as tune from "./tune.js";
import * as runs from "./runs.js";

const $ = (id) => document.getElementById(id);
const TABS = ["check", "field", "harvest", "tune", "runs"];
const SILENT_MS = 1500;  // without a word: what is shown is old
const DEAD_MS = 3000;    // without a word: the connection leads nowhere, another is opened
const OPENS_MS = 8000;   // for a connection to come about over a slow link
const HERE_MS = 500;
const MOMENTS_MS = 10000; // within which a page that drove takes the free wheel again by itself
const POST_MS = 3000;    // for a STOP that goes round the socket to be answered
const TAP_MS = 700;      // between a finger's coming down and the click that follows
const ASKED_UNASKED = ["hello", "look", "here", "take", "runs", "colour_begin", "let_go"];  // by no finger, or beside what a finger asks

export const world = { now: null, plan: null, trail: [], ended: null, goal: null, stuck: false, check: null, field: null, alone: null, paired: true };
let socket = null;
let heardAt = 0;         // the panel's last word, of whatever
let nowAt = 0;           // how things stand was told last
let awakeAt = 0;         // this page's own last tick, or when it woke up
let tickAt = 0;
let droveAt = -Infinity; // this page was told last that it drives
let goesOn = false;      // something did, when that was known last
let again = 0;
let tab = "check";
let stop = null;         // the STOP that waits: {id, at, tries}
let before = {};         // of the last snapshot, for sounds
let secondsSaid = null;
let retry = 300;

// ---- STOP ---------------------------------------------------------------------------------------

let stopTimer = 0;
let pressedAt = -TAP_MS;

function pressStop() {
  pressedAt = performance.now();
  stop = { id: `${Date.now()}-${Math.random().toString(36).slice(2, 8)}`, at: pressedAt, done: false, tries: 0, problem: false };
  sayStop("wait", t("stop.sent"));
  sendStop();
  window.dispatchEvent(new Event("stopped"));
  sound.wake();
  sound.stopped();
}

// Again and again until the board confirms. A socket that looks open may lead nowhere: what is not
// confirmed at once takes a connection of its own as well.
function sendStop() {
  clearTimeout(stopTimer);
  if (!stop || stop.done) return;
  const open = socket && socket.readyState === WebSocket.OPEN;
  if (open) socket.send(JSON.stringify({ do: "stop", id: stop.id }));
  if (!linked() || stop.tries > 0) fetch(`stop?id=${stop.id}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: "{}", keepalive: true, signal: AbortSignal.timeout?.(POST_MS) }).catch(() => {});
  stop.tries += 1;
  stopTimer = setTimeout(sendStop, open ? 400 : 700);
  sayUnconfirmed();
}

function sayUnconfirmed() {
  const late = performance.now() - stop.at > 1000;
  if (!linked()) sayStop("bad", t("stop.no_laptop"));
  else if (stop.problem || world.alone) sayStop("bad", t("stop.no_board"));
  else if (late) sayStop("bad", t("stop.unconfirmed"));
}

function hearStop(now) {
  if (stop?.done && before.mode === "idle" && now.mode !== "idle") { stop = null; sayStop("", ""); }
  if (!stop || stop.done || !now.stop || now.stop.id !== stop.id) return;
  if (now.stop.confirmed) {
    stop.done = true;
    const ms = Math.round(performance.now() - stop.at);
    document.body.dataset.stopMs = String(ms);
    sayStop("good", t("stop.confirmed", { ms }));
  } else if (now.stop.problem) { stop.problem = true; sayUnconfirmed(); }
}

function sayStop(kind, text) {
  const line = $("stop-said");
  line.dataset.kind = kind;
  if (line.textContent !== text) line.textContent = text;
}

$("stop").addEventListener("pointerdown", (event) => { event.preventDefault(); pressStop(); });
$("stop").addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); if (!event.repeat) pressStop(); } });
// A screen reader and a voice press it by a click alone. Without this script the form itself is sent.
$("stop-form").addEventListener("submit", (event) => { event.preventDefault(); if (performance.now() - pressedAt > TAP_MS) pressStop(); });

// ---- the socket ---------------------------------------------------------------------------------

// What cannot be told now is not told later: nobody would expect it any more. With each wish goes
// which state it was asked on the sight of, so that the panel refuses what comes late.
export function ask(wish) {
  if (linked()) { socket.send(JSON.stringify({ ...wish, seen: world.now?.t })); return true; }
  if (!ASKED_UNASKED.includes(wish.do)) notice(t("why.no_laptop"));
  return false;
}

const linked = () => socket?.readyState === WebSocket.OPEN && performance.now() - heardAt < SILENT_MS;
const live = () => linked() && world.now !== null && performance.now() - nowAt < SILENT_MS;

function connect() {
  clearTimeout(again);
  const mine = new WebSocket(`ws://${location.host}/live`);
  socket = mine;
  heardAt = performance.now();
  mine.binaryType = "arraybuffer";
  mine.onopen = () => {
    retry = 300;
    heardAt = performance.now();
    // The panel tells what there is of these. What another panel told before is over.
    Object.assign(world, { now: null, plan: null, trail: [], ended: null, goal: null, stuck: false, check: null, alone: null, paired: true });
    check.hear({ lines: [], question: null, done: false, green: false });
    look();
    ask({ do: "hello" });
    show();
  };
  mine.onmessage = (event) => {
    heardAt = performance.now();
    if (event.data instanceof ArrayBuffer) hearPicture(event.data);
    else hear(JSON.parse(event.data));
  };
  mine.onclose = lose;
}

// Without waiting for its end: over a link that is lost, that takes minutes.
function lose() {
  if (socket) { socket.onopen = socket.onmessage = socket.onclose = null; socket.close(); }
  socket = null;
  clearTimeout(again);
  again = setTimeout(connect, retry);
  retry = Math.min(3000, retry * 1.5);
  checkPairing();
  show();
}

async function checkPairing() {
  try {
    const answer = await fetch("paired", { signal: AbortSignal.timeout?.(POST_MS) });
    world.paired = (await answer.json()).paired;
  } catch { /* nobody answers */ }
  show();
}

function hear(message) {
  switch (message.kind) {
    case "now": nowAt = performance.now(); world.now = message; world.alone = null; hearStop(message); hearSounds(message); break;
    case "alone": world.now = null; world.alone = message; break;
    case "plan": world.plan = message.boundary.length ? message : null; if (!message.anew) world.trail = []; break;
    case "trail": world.trail = message.all ? message.places : world.trail.concat(message.places); break;
    case "ended": world.ended = message; break;
    case "goal": world.goal = message.place ? message : null; world.stuck = Boolean(message.stuck); break;
    case "check": world.check = message; check.hear(message); break;
    case "field": world.field = message; field.hear(message); break;
    case "colour": tune.hear(message); break;
    case "pid": tune.hearPid(message); break;
    case "runs": runs.hear(message); break;
    case "failed": notice(`${has(`failed.${message.what}`) ? t(`failed.${message.what}`) : message.what}: ${message.code ? filled(`problem.${message.code}`, message.values) : said(message.why)}`); break;
    case "refused": notice(t(`refused.${message.what}`)); if (message.what === "watching" && world.field) field.hear(world.field); break;
    default: return;
  }
  show();
}

let bitmap = null;
let pictures = 0;
async function hearPicture(data) {
  const number = ++pictures;
  let found;
  try { found = await createImageBitmap(new Blob([data], { type: "image/jpeg" })); } catch { return; }
  if (number !== pictures) { found.close(); return; }
  bitmap?.close();  // a day has a hundred thousand of them
  bitmap = found;
  if (tab === "harvest") showPicture();
}

const blind = (camera) => !camera.there || Boolean(camera.problem) || camera.age_s > SILENT_MS / 1000;
function showPicture() { drawPicture($("picture"), bitmap, live() ? world.now : null, !live() || blind(world.now.camera)); }

function hearSounds(now) {
  const bad = now.board ? now.board.faults.length > 0 : false;
  const here = { bad, phase: now.pilot?.phase, paused: now.paused, mode: now.mode };
  if (bad && !before.bad) sound.fault();
  if (here.phase === "fault" && before.phase !== "fault") sound.fault();
  if (here.phase === "finished" && before.phase !== "finished") sound.finished();
  if (now.paused && !before.paused) sound.waiting();
  if (before.mode === "drive" && now.mode === "idle" && before.phase !== "finished") sound.stopped();
  if (now.mode === "drive" && before.mode !== "drive") $("compass").value = "";  // the next run begins with another heading
  before = here;
  const left = now.mode === "countdown" && now.countdown_s != null ? Math.ceil(now.countdown_s) : null;
  if (left !== null && left !== secondsSaid && left > 0) sound.second(left === 1);
  secondsSaid = left;
}

let noticeTimer = 0;
export function notice(text) {
  $("notice").textContent = text;
  $("notice").hidden = false;
  clearTimeout(noticeTimer);
  noticeTimer = setTimeout(() => { $("notice").hidden = true; }, 12000);
}

// ---- awake --------------------------------------------------------------------------------------

let lock = null;
async function stayAwake() {
  const wanted = world.now?.driver && world.now.mode !== "idle" && !document.hidden;
  if (wanted && !lock && navigator.wakeLock) {
    try { lock = await navigator.wakeLock.request("screen"); lock.addEventListener("release", () => { lock = null; }); } catch { /* over plain http */ }
  } else if (!wanted && lock) { lock.release(); lock = null; }
}
setInterval(() => {
  const at = performance.now();
  // After a sleep the socket's words are still to come.
  if (at - tickAt > DEAD_MS) awakeAt = at;
  tickAt = at;
  if (socket && at - Math.max(heardAt, awakeAt) > (socket.readyState === WebSocket.OPEN ? DEAD_MS : OPENS_MS)) lose();
  // In a pocket nobody sees that the link is lost.
  if (live()) goesOn = world.now.mode !== "idle";
  else if (goesOn) { goesOn = false; sound.fault(); }
  if (live() && world.now.driver) droveAt = nowAt;
  if (live() && world.now.driver && !document.hidden) ask({ do: "here" });
  // A link that was lost for moments changes nobody's place; what stands goes on standing.
  if (live() && !world.now.driven && !document.hidden && at - droveAt < MOMENTS_MS) ask({ do: "take" });
  stayAwake();
}, HERE_MS);
setInterval(show, 1000);

// ---- what is shown ------------------------------------------------------------------------------

function look() { ask({ do: "look", picture: tab === "harvest" || tab === "tune", page: tab }); }

export function open(name) {
  tab = name;
  for (const one of TABS) $(`page-${one}`).hidden = one !== name || !world.paired;
  for (const button of document.querySelectorAll("#tabs button")) {
    if (button.dataset.tab === name) button.setAttribute("aria-current", "page"); else button.removeAttribute("aria-current");
  }
  try { sessionStorage.setItem("tab", name); } catch { /* private browsing */ }
  look();
  if (name === "runs") ask({ do: "runs" });
  show();
}

// What the machine is doing: [kind of colour, word, reason].
function state(now) {
  if (!world.paired) return ["wait", t("state.unpaired"), ""];
  if (!linked()) return ["bad", t("state.no_laptop"), t("state.no_laptop.why")];
  if (!now) return world.alone ? ["bad", t("state.no_machine"), world.alone.why ? said(world.alone.why) : t("state.no_machine.why")] : ["wait", "…", ""];
  const board = now.board;
  const faults = board ? board.faults : [];
  if (now.link.problem) return ["bad", t("state.no_board"), now.link.problem === "silent" ? t("link.silent") : said(now.link.problem)];
  if (now.mode === "prepare") return ["wait", t("state.prepare"), t("harvest.preparing")];
  if (now.mode === "countdown") return ["wait", t("state.countdown"), ""];
  if (faults.length) return ["bad", t("state.fault"), faults.map((name) => t(`fault.${name}`)).join("; ")];
  if (now.mode === "drive") {
    if (now.paused) return ["wait", t("state.paused"), [t(`paused.${now.paused_why || "asked"}`), ...(now.driver ? [] : [t(now.driven ? "why.other_drives" : "why.not_driver")])].join(" ")];
    const pilot = now.pilot;
    const kind = { follow: "go", turn: "go", align: "go", finished: "go", fault: "bad" }[pilot.phase] ?? "wait";
    return [kind, t(`phase.${pilot.phase}`), reason(pilot)];
  }
  if (now.mode === "check") return ["wait", t("state.check"), ""];
  if (now.mode === "jog") return ["wait", t("state.jog"), ""];
  if (now.mode === "pid") return ["wait", t("state.pid"), ""];
  if (world.ended?.outcome === "finished") return ["go", t("state.finished"), reason(world.ended)];
  return ["idle", t("state.idle"), ""];
}

function signal(id, bad, text) {
  const one = $(`signal-${id}`);
  one.dataset.bad = bad === null ? "off" : bad ? "1" : "0";
  if (one.textContent !== text) one.textContent = text;
}

function show() {
  if (!has("title")) return;  // without texts there is nothing to say
  const now = live() ? world.now : null;
  const [kind, word, why] = state(now);
  $("state").dataset.kind = kind;
  if ($("state-word").textContent !== word) $("state-word").textContent = word;
  if ($("state-why").textContent !== why) $("state-why").textContent = why;
  $("page-pair").hidden = world.paired;
  for (const id of ["tabs", "signals", "pause"]) $(id).hidden = !world.paired;
  if (!world.paired) { for (const one of TABS) $(`page-${one}`).hidden = true; return; }
  if ($(`page-${tab}`).hidden) $(`page-${tab}`).hidden = false;
  signal("laptop", !linked(), t(linked() ? "signal.laptop" : "signal.no_laptop"));
  // What is not known now is not shown as it was.
  for (const id of ["board", "battery", "camera", "gnss"]) $(`signal-${id}`).hidden = !now;
  $("pause").disabled = now?.mode !== "drive" || !now.driver;
  $("countdown").hidden = now?.mode !== "countdown";
  document.body.dataset.mode = now?.mode ?? "";
  showTab(now);
  if (!now) return;
  const silent = Boolean(now.link.problem), board = silent ? null : now.board;
  signal("board", silent, t(silent ? "signal.no_board" : "signal.board", { state: t(`board.${board?.state ?? "SAFE"}`) }));
  signal("battery", board ? board.battery_v < 11 : null, board ? t("signal.battery", { volts: board.battery_v }) : t("signal.no_battery"));
  const camera = now.camera;
  signal("camera", camera.there ? blind(camera) : null, t(blind(camera) ? "signal.no_camera" : "signal.camera"));
  const fix = now.gnss.fix;
  const located = fix && fix.quality > 0 && fix.age_s < 3;
  signal("gnss", now.gnss.there ? !located : null, located ? t("signal.gnss", { satellites: fix.satellites }) : t("signal.no_gnss"));
  $("pause").textContent = t(now.paused ? "pause.go_on" : "pause.pause");
  document.body.dataset.phase = now.pilot?.phase ?? "";
  document.body.dataset.paused = now.paused ? "1" : "0";
  if (now.mode === "countdown") $("countdown-number").textContent = String(Math.max(0, Math.ceil(now.countdown_s ?? 0)));
}

function showTab(now) {
  const shown = { ...world, now };
  if (tab === "harvest") showHarvest(now, shown);
  if (tab === "check") { check.show(shown); put("check-why", now?.mode === "check" ? "" : whyNot(now)); }
  if (tab === "field") { field.show(shown); put("walk-why", whyNot(now, "gnss")); }
  if (tab === "tune") { tune.show(shown); put("pid-why", now?.mode === "pid" ? "" : whyNot(now)); }
  if (tab === "runs") runs.show(shown);
}

// Why a button that begins something cannot be pressed, in words beside it.
function whyNot(now, device) {
  if (!now) return t(world.alone ? "why.no_machine" : "why.no_laptop");
  if (now.driven && !now.driver) return t("why.other_drives");
  if (now.mode !== "idle") return t("why.busy");
  return device && !now[device].there ? t(`why.no_${device}`) : "";
}

function put(id, text) { if ($(id).textContent !== text) $(id).textContent = text; }

const MINUTE = 60;
function duration(seconds) {
  if (seconds == null) return t("unknown");
  return t("minutes", { minutes: Math.max(1, Math.round(seconds / MINUTE)) });
}

function showHarvest(now, shown) {
  const pilot = now?.pilot;
  const facts = [];
  if (pilot) {
    facts.push(["facts.done", pilot.done == null ? t("unknown") : t("percent", { percent: Math.round(pilot.done * 100) })]);
    facts.push(["facts.left", duration(pilot.left_s)]);
    facts.push(["facts.side", `${pilot.side} / ${pilot.sides || "?"}`]);
    facts.push(["facts.edge", pilot.view?.offset_m == null ? t("unknown") : t("centimetres", { cm: (pilot.view.offset_m * 100).toFixed(0) })]);
  }
  if (pilot && now.board) {
    facts.push(["facts.blade", t(now.board.blade ? "on" : "off")]);
    facts.push(["facts.speed", now.board.speed_mps == null ? t("unknown") : t("metres_a_second", { speed: now.board.speed_mps.toFixed(2) })]);
    facts.push(["facts.battery", t("volts", { volts: now.board.battery_v })]);
  }
  const list = $("facts");
  const html = facts.map(([key, value]) => [t(key), value]);
  if (list.dataset.shown !== JSON.stringify(html)) {
    list.dataset.shown = JSON.stringify(html);
    list.replaceChildren(...html.flatMap(([name, value]) => {
      const dt = document.createElement("dt"); dt.textContent = name;
      const dd = document.createElement("dd"); dd.textContent = value;
      return [dt, dd];
    }));
  }
  const latched = now?.board?.faults ?? [];
  const faults = latched.map((name) => [t(`fault.${name}`), t(`remedy.${name}`)]);
  if (!faults.length && now?.mode === "idle" && world.ended?.outcome === "fault") faults.push([t("harvest.ended_by"), reason(world.ended)]);
  if ($("faults").dataset.shown !== JSON.stringify(faults)) {
    $("faults").dataset.shown = JSON.stringify(faults);
    $("faults").replaceChildren(...faults.map(([what, todo]) => {
      const box = document.createElement("div"); box.className = "fault";
      const bold = document.createElement("b"); bold.textContent = what;
      box.append(bold, todo);
      return box;
    }));
  }
  const idle = now?.mode === "idle";
  $("take").hidden = !now || now.driver;
  $("take").disabled = !now || now.driven;
  $("take").textContent = t(now?.driven ? "harvest.watching" : "harvest.take");
  const left = idle && world.ended?.resume && world.ended.outcome !== "finished";
  const resumable = left && !world.stuck;
  $("start").hidden = !idle;
  $("start").classList.toggle("second", Boolean(resumable));
  put("start-word", t(resumable ? "harvest.start_anew" : "harvest.start"));
  for (const id of ["resume", "compass", "compass-label"]) $(id).hidden = !resumable;
  const goal = resumable ? world.goal : null;
  $("goal-said").textContent = goal ? t("harvest.goal", { side: goal.side, along: goal.along_m, compass: goal.compass_deg }) : left && world.stuck ? t("harvest.stuck") : "";
  const ready = Boolean(idle && !now.link.problem && now.driver && now.green && world.field?.plan) && !latched.length;
  $("start").disabled = $("resume").disabled = !ready;
  put("start-why", !now ? whyNot(now) : !idle || ready ? "" : t(now.link.problem ? "why.no_board" : !now.driver ? "why.not_driver" : latched.length ? "why.fault" : !world.field?.plan ? "why.no_field" : "why.no_check"));
  $("clear").hidden = !(idle && latched.length);
  $("clear").disabled = !now?.driver;
  $("jog").hidden = !(idle || now?.mode === "jog");
  for (const key of document.querySelectorAll("#jog-keys button")) key.disabled = !now?.driver;
  drawMap($("map"), shown);
  $("map").setAttribute("aria-label", mapSaid(shown));
  showPicture();
  const camera = now?.camera;
  $("picture-said").textContent = !camera ? "" : camera.problem ? t("picture.none", { why: said(camera.problem) }) : pilot?.view ? t("picture.said", { confidence: pilot.view.confidence }) : "";
  $("picture").setAttribute("aria-label", t("picture.label"));
}

// ---- pressing -----------------------------------------------------------------------------------

$("pause").addEventListener("click", () => ask({ do: world.now?.paused ? "go_on" : "pause" }));
$("take").addEventListener("click", () => { sound.wake(); ask({ do: "take" }); });
$("clear").addEventListener("click", () => ask({ do: "clear" }));

const HOLD_MS = 2050;
const HOLD_TICK_MS = 50;
const FINGER_GOES = ["pointerup", "pointerleave", "pointercancel", "blur"];

// A button that is disabled under a finger does not hear the finger go, nor does a page that is hidden.
const letGoUnheard = (button) => button.disabled || document.hidden;

function hold(id, order) {
  const button = $(id);
  let timer = 0, since = 0;
  const begin = (event) => {
    event.preventDefault();
    if (button.disabled || timer) return;
    sound.wake();
    ask({ do: "hold" });
    button.classList.add("down");
    since = performance.now();
    timer = setInterval(() => {
      if (letGoUnheard(button)) return release();
      if (performance.now() - since < HOLD_MS) return;
      clearInterval(timer);
      timer = 0;
      button.classList.remove("down");
      ask({ do: "start", resume: order, heading_deg: order && $("compass").value !== "" ? Number($("compass").value) : null });
    }, HOLD_TICK_MS);
  };
  const release = () => {
    if (!timer) return false;
    clearInterval(timer);
    timer = 0;
    button.classList.remove("down");
    ask({ do: "let_go" });
    return true;
  };
  const end = () => { if (release()) notice(t("harvest.hold_longer")); };
  window.addEventListener("stopped", release);
  button.addEventListener("pointerdown", begin);
  for (const kind of FINGER_GOES) button.addEventListener(kind, end);
  button.addEventListener("keydown", (event) => { if ((event.key === " " || event.key === "Enter") && !event.repeat) begin(event); });
  button.addEventListener("keyup", end);
  button.addEventListener("contextmenu", (event) => event.preventDefault());
}
hold("start", false);
hold("resume", true);

for (const key of document.querySelectorAll("#jog-keys button")) {
  const [speed, steer] = key.dataset.jog.split(",").map(Number);
  let timer = 0;
  const begin = (event) => { event.preventDefault(); if (timer || key.disabled) return; ask({ do: "jog", speed, steer_deg: steer }); timer = setInterval(() => (letGoUnheard(key) ? end() : ask({ do: "jog", speed, steer_deg: steer })), 150); };
  const end = () => { if (!timer) return; clearInterval(timer); timer = 0; ask({ do: "jog", speed: 0, steer_deg: steer }); };
  key.addEventListener("pointerdown", begin);
  window.addEventListener("stopped", () => { clearInterval(timer); timer = 0; });
  for (const kind of FINGER_GOES) key.addEventListener(kind, end);
  key.addEventListener("keydown", (event) => { if (event.key === " " || event.key === "Enter") begin(event); });
  key.addEventListener("keyup", end);
}

$("pair-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  let found;
  try {
    const answer = await fetch("pair", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ code: $("pair-code").value }) });
    found = await answer.json();
  } catch { $("pair-said").textContent = t("why.no_laptop"); return; }
  if (found.paired) { world.paired = true; $("pair-said").textContent = ""; retry = 300; lose(); open(tab); }
  else $("pair-said").textContent = found.wait_s ? t("pair.wait", { seconds: found.wait_s }) : t("pair.wrong");
});

// What is scrolled to, or has the focus, never lies under the bars, however tall their words are.
const bars = new ResizeObserver(() => {
  for (const [bar, name] of [["header", "--head"], ["footer", "--foot"]]) {
    document.documentElement.style.setProperty(name, `${Math.ceil(document.querySelector(bar).getBoundingClientRect().height)}px`);
  }
});
for (const bar of ["header", "footer"]) bars.observe(document.querySelector(bar));

document.addEventListener("pointerdown", sound.wake, { once: true });
// Who looks at the page again, or is on the network again, does not wait for the next try.
function wake() {
  if (!document.hidden && !socket) { retry = 300; connect(); }
  show();
}
document.addEventListener("visibilitychange", wake);
window.addEventListener("online", wake);

// ---- begin --------------------------------------------------------------------------------------

export async function speak(code) {
  // On a flaky network the texts may take more than one try.
  while (!await load(code)) await new Promise((done) => setTimeout(done, 1000));
  document.title = t("title");
  $("stop").setAttribute("aria-label", t("stop.label"));
  $("tabs").setAttribute("aria-label", t("tabs"));
  $("tabs").replaceChildren(...TABS.map((name) => {
    const button = document.createElement("button");
    button.textContent = t(`tab.${name}`);
    button.dataset.tab = name;
    button.addEventListener("click", () => open(name));
    return button;
  }));
  $("legend").replaceChildren(...[["cut", "#e6c86e"], ["left", "#2e7d32"], ["fence", "#d9d9d9"], ["keep_out", "#c62828"], ["machine", "#0a2f7a"], ["next", "#000"]].map(([name, colour]) => {
    const one = document.createElement("li");
    const box = document.createElement("i");
    box.dataset.colour = name;
    box.style.background = colour;
    one.append(box, t(`legend.${name}`));
    return one;
  }));
  runs.languages(LANGUAGES, language, speak);
  for (const one of ["facts", "faults"]) delete $(one).dataset.shown;
  check.speak();
  tune.speak();
  if (world.field) field.hear(world.field);
  open(tab);
}

check.bind(ask);
field.bind(ask);
tune.bind(ask);
let kept = "en";
try { kept = localStorage.getItem("language") ?? (navigator.language.startsWith("ur") ? "ur" : "en"); tab = sessionStorage.getItem("tab") ?? tab; } catch { /* private browsing */ }
connect();
speak(LANGUAGES.includes(kept) ? kept : "en");
