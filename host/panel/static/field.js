// The field: walked with the phone in the hand, mended with a finger, planned at once.
import { t, said } from "./texts.js";
import { fieldOn } from "./map.js";
import * as handles from "./handles.js";

const $ = (id) => document.getElementById(id);
const FORMS = [["form-straight", false], ["form-walked", true]];
const HANDLE = 17;
const REACH = 60;        // of a finger, on the canvas
const MIDDLE_FROM = 150;  // on the canvas: only so long a side has a handle in its middle
const TREMOR = 8;        // a finger that goes less far has touched, not dragged
const SETTLED_MS = 700;  // after the last key that moves a corner, before it is planned with
let ask = () => {};
let field = null;
let view = null;
let tool = null;      // "move", "keep_out" or null
let grabbed = null;   // the corner that moves: {index, at}, by keys {by} since it was told, by a finger {from} where it came down until it goes, and {fresh} where it is none yet
let chosen = null;    // the corner that the button removes
let settling = 0;
let drawn = [];       // the keep-out's corners so far
let cross = null;     // where a keyboard sets the next one
let awaited = null;   // the corner that gets the focus when it is there
let working = false;  // a wish is under way that may take long
let map = null;

export function bind(asker) {
  ask = asker;
  map = $("field-map");
  $("walk-begin").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "walk_begin" }); });
  $("walk-end").addEventListener("click", () => work({ do: "walk_end" }));
  $("walk-drop").addEventListener("click", () => ask({ do: "walk_drop" }));
  for (const [id, recorded] of FORMS) $(id).addEventListener("click", () => { if (field.recorded !== recorded) work({ do: "form", recorded }); });
  $("field-move").addEventListener("click", (event) => choose("move", event));
  $("field-keep-out").addEventListener("click", (event) => {
    if (tool === "keep_out" && drawn.length > 2) work({ do: "keep_out", ring: drawn });
    choose("keep_out", event);
  });
  $("field-keep-out-drop").addEventListener("click", () => { drawn = []; work({ do: "keep_out_drop" }); });
  // Emptied, or no number: what holds is shown again. What is no gap, the panel says.
  $("field-gap").addEventListener("change", () => { const box = $("field-gap"); if (box.value === "") box.value = field?.gap_m ?? ""; else work({ do: "gap", gap_m: Number(box.value) }); });
  $("field-corner").addEventListener("change", () => work({ do: "corner", corner: Number($("field-corner").value) }));
  $("field-file").addEventListener("change", () => work({ do: "open", name: $("field-file").value }));
  map.addEventListener("pointerdown", begin);
  map.addEventListener("pointermove", move);
  map.addEventListener("pointerup", end);
  map.addEventListener("pointercancel", () => { grabbed = null; draw(); });
  $("field-drop").addEventListener("click", () => {
    if (tool === "keep_out") { drawn.pop(); draw(); }
    else if (change({ do: "drop_corner", index: chosen })) pick(null);
  });
  handles.bind($("field-handles"), {
    move: nudge,
    press: () => { if (tool === "keep_out") { drawn.push(cross); draw(); } else end(); },
    drop: (index) => { if (tool === "keep_out") { drawn.pop(); draw(); } else change({ do: "drop_corner", index }); },
    add: (index) => { if (tool === "move" && change({ do: "add_corner", index })) awaited = index + 1; },
    focus: (index) => { if (tool === "move") { chosen = index; draw(); } },
    leave: () => $(tool === "move" ? "field-move" : "field-keep-out").focus(),
    blur: () => { end(); set("field-moved", ""); },
  });
}

// Planning takes a while: until its outcome is told, the page says that it is at work.
function work(wish) {
  ask({ do: "take" });
  working = ask(wish);
  say();
}

function choose(name, event) {
  end();
  ask({ do: "take" });
  tool = tool === name ? null : name;
  drawn = [];
  chosen = null;
  cross = field?.boundary ? [0, 1].map((axis) => mean(field.boundary.map((p) => p[axis]))) : null;
  $("field-handles").dataset.tool = tool ?? "";
  set("field-keys", tool ? t(tool === "move" ? "field.keys.move" : "field.keys.keep_out") : "");
  map.style.touchAction = tool ? "none" : "auto";
  $("field-move").setAttribute("aria-pressed", String(tool === "move"));
  $("field-keep-out").setAttribute("aria-pressed", String(tool === "keep_out"));
  draw();
  // Who chose it with a key goes on with keys.
  if (tool && event.detail === 0) $("field-handles").children[tool === "move" ? field.corner ?? 0 : 0]?.focus();
}

const mean = (all) => all.reduce((sum, one) => sum + one, 0) / all.length;

// A change of the corners' number; one at a time, for it changes their numbers.
function change(wish) {
  if (working) return false;
  end();
  work(wish);
  return working;
}

function nudge(index, east, north) {
  if (tool === "keep_out") cross = [cross[0] + east, cross[1] + north];
  else {
    if (grabbed && grabbed.index !== index) end();
    const by = grabbed?.by ?? [0, 0];
    grabbed = { index, by: [by[0] + east, by[1] + north] };
    follow();
    clearTimeout(settling);
    settling = setTimeout(end, SETTLED_MS);
  }
  draw();
  const name = $("field-handles").children[index].getAttribute("aria-label");
  set("field-moved", tool === "keep_out" ? name : `${ways(grabbed.by)}. ${name}`);
}

// A corner that keys move goes with its field: the panel counts from the first corner, which may
// have been moved itself meanwhile.
function follow() {
  const from = field.boundary?.[grabbed.index];
  if (from) grabbed.at = from.map((one, axis) => one + grabbed.by[axis]);
  else grabbed = null;
}

const ways = ([east, north]) => [[east, "east", "west"], [north, "north", "south"]].filter(([by]) => Math.abs(by) > 0.01)
  .map(([by, more, less]) => t(`way.${by > 0 ? more : less}`, { metres: Math.abs(by).toFixed(1) })).join(" + ") || t("way.back");

function place(event) {
  const box = map.getBoundingClientRect();
  return view.back((event.clientX - box.left) / box.width * map.width, (event.clientY - box.top) / box.height * map.height);
}

function begin(event) {
  if (!tool || !view || !field?.boundary) return;
  event.preventDefault();
  end();
  const here = place(event);
  if (tool === "keep_out") { drawn.push(here); draw(); return; }
  const away = ({ at }) => Math.hypot(at[0] - here[0], at[1] - here[1]);
  const held = [...field.boundary.map((at, index) => ({ index, at })), ...middles(field.boundary)];
  const nearest = held.reduce((one, other) => (away(other) < away(one) ? other : one));
  if (away(nearest) * view.scale >= REACH) return pick(null);
  grabbed = { ...nearest, from: [event.clientX, event.clientY] };
  map.setPointerCapture(event.pointerId);
}

// What becomes a corner where it is taken hold of; not while the panel may be numbering them anew.
function middles(ring) {
  if (working) return [];
  return ring.map((p, index) => [p, ring[(index + 1) % ring.length], index]).filter(([p, q]) => Math.hypot(p[0] - q[0], p[1] - q[1]) * view.scale >= MIDDLE_FROM)
    .map(([p, q, index]) => ({ index, at: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2], fresh: true }));
}

function put(ring, { index, at, fresh }) {
  ring.splice(fresh ? index + 1 : index, fresh ? 0 : 1, at);
}

function pick(index) {
  chosen = index;
  set("field-moved", index === null ? "" : corner(field.boundary, index));
  draw();
}

function move(event) {
  if (grabbed === null || grabbed.by) return;
  if (grabbed.from && Math.hypot(event.clientX - grabbed.from[0], event.clientY - grabbed.from[1]) < TREMOR) return;
  grabbed.from = null;
  grabbed.at = place(event);
  draw();
}

function end() {
  clearTimeout(settling);
  if (grabbed === null) return;
  const { index, at: [x, y], by, from, fresh } = grabbed;
  grabbed = null;
  if (fresh || !from) {
    put(field.boundary, { index, at: [x, y], fresh });
    work({ do: fresh ? "add_corner" : "move_corner", index, x, y });
  }
  if (by) draw();
  else pick(fresh ? index + 1 : index);
}

export function hear(message) {
  if (field?.name !== message.name || chosen >= (message.boundary?.length ?? 0)) chosen = null;
  field = structuredClone(message);
  working = false;
  if (grabbed?.by) follow();
  if (document.activeElement !== $("field-gap")) $("field-gap").value = field.gap_m ?? "";
  const corners = (field.boundary ?? []).map((_, k) => new Option(t("field.corner.name", { corner: k + 1 }), String(k)));
  $("field-corner").replaceChildren(...corners);
  $("field-corner").value = String(field.corner ?? 0);
  const files = field.files.map((name) => new Option(name.replace(/\.geojson$/, ""), name));
  if (!field.name) files.unshift(new Option(t("field.none"), ""));
  $("field-file").replaceChildren(...files);
  $("field-file").value = field.name ?? "";
  draw();
  if (awaited !== null && $("field-handles").contains(document.activeElement)) $("field-handles").children[awaited]?.focus();
  awaited = null;
}

function draw() {
  if (!map) return;
  offer();
  const context = map.getContext("2d");
  const walked = field?.walk?.track ?? [];
  const boundary = field?.boundary ?? [];
  if (!boundary.length && walked.length < 2) {
    context.clearRect(0, 0, map.width, map.height);
    context.fillStyle = "#000";
    context.font = "bold 30px sans-serif";
    context.textAlign = "center";
    context.fillText(t("map.none"), map.width / 2, map.height / 2);
    handles.lay($("field-handles"), map, [], []);
    return;
  }
  drawField(context, walked.length > 1 && field.walk.on ? walked : boundary);
}

function drawField(context, still) {
  const walking = field.walk?.on && field.walk.track.length > 1;
  const shown = [...still];
  if (grabbed) put(shown, grabbed);
  let finish;
  // The map stays where it is under a corner that moves.
  [, view, finish] = fieldOn(map, shown, walking ? [] : field.keep_outs ?? [], walking ? 0 : field.gap_m, still);
  if (walking) context.clearRect(0, 0, map.width, map.height);
  if (!walking) {
    for (const side of field.plan?.sides ?? []) stroke(context, side, "#fff", 2);
    finish();
    if (field.walked) stroke(context, field.walked, "#ffd54a", 3);
    if (tool === "move" && !grabbed) for (const { at } of middles(shown)) plus(context, view.at(at));
    numbers(context, shown);
    if (drawn.length) { stroke(context, drawn, "#c62828", 6); for (const one of drawn) dot(context, one, 7, "#c62828"); }
  } else stroke(context, field.walk.track, "#0a2f7a", 6);
  const held = walking || !tool ? [] : tool === "move" ? shown : [cross];
  handles.lay($("field-handles"), map, held.map(view.at), held.map((_, k) => (tool === "move" ? corner(shown, k) : crossSaid(shown))));
  if (field.here) dot(context, field.here, 12, "#0a58ff");
}

function dot(context, place, radius, colour) {
  context.beginPath();
  context.arc(...view.at(place), radius, 0, 7);
  context.fillStyle = colour;
  context.fill();
  context.lineWidth = 4;
  context.strokeStyle = "#fff";
  context.stroke();
}

function plus(context, [u, v]) {
  context.beginPath();
  context.arc(u, v, 13, 0, 7);
  context.fillStyle = "#fff";
  context.fill();
  context.lineWidth = 2;
  context.moveTo(u - 8, v); context.lineTo(u + 8, v);
  context.moveTo(u, v - 8); context.lineTo(u, v + 8);
  context.strokeStyle = "#000";
  context.stroke();
}

// Where a corner is, by what a tape measures.
function corner(shown, k) {
  const back = (k + shown.length - 1) % shown.length, ahead = (k + 1) % shown.length;
  return t("field.handle", { corner: k + 1, corners: shown.length, back: back + 1, before: metres(shown[k], shown[back]), ahead: ahead + 1, after: metres(shown[k], shown[ahead]) });
}

function crossSaid(shown) {
  const away = shown.map((p) => Math.hypot(p[0] - cross[0], p[1] - cross[1]));
  const nearest = away.indexOf(Math.min(...away));
  return t("field.cross", { metres: metres(cross, shown[nearest]), corner: nearest + 1, points: drawn.length });
}

const metres = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]).toFixed(1);

// Numbers where there is room for them; a boundary as it was walked has points nearer to each other.
function numbers(context, shown) {
  context.font = "bold 26px sans-serif";
  context.textAlign = "center";
  const at = shown.map(view.at), first = field.corner ?? 0, numbered = [];
  for (const k of [first, ...at.keys()]) if (numbered.every((other) => Math.hypot(at[k][0] - at[other][0], at[k][1] - at[other][1]) > 2 * HANDLE)) numbered.push(k);
  at.forEach(([u, v], k) => {
    const large = numbered.includes(k);
    context.beginPath();
    context.arc(u, v, large ? HANDLE : 7, 0, 7);
    context.fillStyle = k === first ? "#0a2f7a" : "#fff";
    context.fill();
    context.lineWidth = k === chosen ? 9 : 3;
    context.strokeStyle = k === chosen ? "#0a58ff" : "#000";
    context.stroke();
    context.fillStyle = k === first ? "#fff" : "#000";
    if (large) context.fillText(String(k + 1), u, v + 9);
  });
}

function stroke(context, points, colour, width) {
  context.beginPath();
  points.forEach((p, k) => { const [u, v] = view.at(p); if (k) context.lineTo(u, v); else context.moveTo(u, v); });
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
}

export function show(world) {
  const mine = Boolean(world.now) && (!world.now.driven || world.now.driver);
  const walk = field?.walk;
  $("walk-begin").disabled = !mine || walk?.on || !world.now?.gnss.there || world.now.mode !== "idle";
  $("walk-end").disabled = $("walk-drop").disabled = !mine;
  $("walk-end").hidden = $("walk-drop").hidden = !walk?.on;
  for (const id of ["field-move", "field-keep-out", "field-keep-out-drop", "field-gap", "field-corner"]) $(id).disabled = !mine || !field?.boundary || walk?.on;
  $("field-form").hidden = !field?.walked;
  for (const [id, recorded] of FORMS) {
    $(id).disabled = !mine || working;
    $(id).setAttribute("aria-pressed", String(field?.recorded === recorded));
  }
  say();
  const sum = field?.summary;
  set("plan-said", sum ? t("plan.said", { sides: sum.sides, turns: sum.turns, minutes: Math.max(1, Math.round(sum.seconds / 60)), length: Math.round(sum.length_m), left: sum.leftover_m2 }) : t("plan.none"));
  $("field-map").setAttribute("aria-label", t("map.label"));
}

// What the field is taken for, and what is wrong with that.
function say() {
  const walk = field?.walk;
  const form = field?.recorded ? "field.said.recorded" : "field.said";
  const walked = walk?.on ? t("field.walk.now", { fixes: walk.fixes, length: Math.round(walk.length_m), back: Math.round(walk.back_m), laps: walk.laps }) : "";
  set("field-said", walked || (field?.boundary ? t(form, { corners: field.boundary.length, area: Math.round(field.area_m2), keep_outs: field.keep_outs.length }) : ""));
  const wrong = (field?.problem ? [field.problem] : []).concat(walk?.on ? [] : (field?.walked ? walk.said : []).concat(field?.summary?.warnings ?? [])).map(said);
  if (!walk?.on && field?.asked != null) wrong.unshift(t("field.begins", { asked: field.asked + 1, corner: field.corner + 1 }));
  if (!walk?.on && field?.inside) wrong.unshift(t("field.inside", { corner: field.corner + 1 }));
  set("field-problem", working ? t("field.working") : wrong.join("; "));
  offer();
}

// The button that takes a corner or a point away: there while there is one.
function offer() {
  const one = $("field-drop"), what = tool === "move" && chosen !== null ? t("field.drop", { corner: chosen + 1 }) : tool === "keep_out" && drawn.length ? t("field.point.drop") : "";
  const left = !what && document.activeElement === one;
  one.hidden = !what;
  one.disabled = working;
  set("field-drop", what);
  if (left) $(tool === "keep_out" ? "field-keep-out" : "field-move").focus();
}

function set(id, text) { if ($(id).textContent !== text) $(id).textContent = text; }
