// The field: walked with the phone in the hand, mended with a finger, planned at once.
import { t, said } from "./texts.js";
import { fieldOn } from "./map.js";

const $ = (id) => document.getElementById(id);
const FORMS = [["form-straight", false], ["form-walked", true]];
const HANDLE = 17;
let ask = () => {};
let field = null;
let view = null;
let tool = null;      // "move", "keep_out" or null
let grabbed = null;   // the corner that moves: {index, at}
let drawn = [];       // the keep-out's corners so far
let working = false;  // a wish is under way that may take long
let map = null;

export function bind(asker) {
  ask = asker;
  map = $("field-map");
  $("walk-begin").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "walk_begin" }); });
  $("walk-end").addEventListener("click", () => work({ do: "walk_end" }));
  $("walk-drop").addEventListener("click", () => ask({ do: "walk_drop" }));
  for (const [id, recorded] of FORMS) $(id).addEventListener("click", () => { if (field.recorded !== recorded) work({ do: "form", recorded }); });
  $("field-move").addEventListener("click", () => choose("move"));
  $("field-keep-out").addEventListener("click", () => {
    if (tool === "keep_out" && drawn.length > 2) work({ do: "keep_out", ring: drawn });
    choose("keep_out");
  });
  $("field-keep-out-drop").addEventListener("click", () => { drawn = []; work({ do: "keep_out_drop" }); });
  $("field-gap").addEventListener("change", () => { const gap = Number($("field-gap").value); if (gap >= 0) work({ do: "gap", gap_m: gap }); });
  $("field-corner").addEventListener("change", () => work({ do: "corner", corner: Number($("field-corner").value) }));
  $("field-file").addEventListener("change", () => work({ do: "open", name: $("field-file").value }));
  map.addEventListener("pointerdown", begin);
  map.addEventListener("pointermove", move);
  map.addEventListener("pointerup", end);
}

// Planning takes a while: until its outcome is told, the page says that it is at work.
function work(wish) {
  ask({ do: "take" });
  working = ask(wish);
  say();
}

function choose(name) {
  ask({ do: "take" });
  tool = tool === name ? null : name;
  drawn = [];
  map.style.touchAction = tool ? "none" : "auto";
  $("field-move").setAttribute("aria-pressed", String(tool === "move"));
  $("field-keep-out").setAttribute("aria-pressed", String(tool === "keep_out"));
  draw();
}

function place(event) {
  const box = map.getBoundingClientRect();
  return view.back((event.clientX - box.left) / box.width * map.width, (event.clientY - box.top) / box.height * map.height);
}

function begin(event) {
  if (!tool || !view || !field?.boundary) return;
  event.preventDefault();
  const here = place(event);
  if (tool === "keep_out") { drawn.push(here); draw(); return; }
  const distances = field.boundary.map((p) => Math.hypot(p[0] - here[0], p[1] - here[1]));
  const nearest = distances.indexOf(Math.min(...distances));
  if (distances[nearest] * view.scale < 60) { grabbed = { index: nearest, at: field.boundary[nearest] }; map.setPointerCapture(event.pointerId); }
}

function move(event) {
  if (grabbed === null) return;
  grabbed.at = place(event);
  draw();
}

function end() {
  if (grabbed === null) return;
  const { index, at: [x, y] } = grabbed;
  field.boundary[index] = [x, y];
  work({ do: "move_corner", index, x, y });
  grabbed = null;
  draw();
}

export function hear(message) {
  field = structuredClone(message);
  working = false;
  if (document.activeElement !== $("field-gap")) $("field-gap").value = field.gap_m ?? "";
  const corners = (field.boundary ?? []).map((_, k) => new Option(t("field.corner.name", { corner: k + 1 }), String(k)));
  $("field-corner").replaceChildren(...corners);
  $("field-corner").value = String(field.corner ?? 0);
  const files = field.files.map((name) => new Option(name.replace(/\.geojson$/, ""), name));
  if (!field.name) files.unshift(new Option(t("field.none"), ""));
  $("field-file").replaceChildren(...files);
  $("field-file").value = field.name ?? "";
  draw();
}

function draw() {
  if (!map) return;
  const context = map.getContext("2d");
  const walked = field?.walk?.track ?? [];
  const boundary = field?.boundary ?? [];
  if (!boundary.length && walked.length < 2) {
    context.clearRect(0, 0, map.width, map.height);
    context.fillStyle = "#000";
    context.font = "bold 30px sans-serif";
    context.textAlign = "center";
    context.fillText(t("map.none"), map.width / 2, map.height / 2);
    return;
  }
  drawField(context, walked.length > 1 && field.walk.on ? walked : boundary);
}

function drawField(context, still) {
  const walking = field.walk?.on && field.walk.track.length > 1;
  const shown = grabbed ? still.map((p, k) => (k === grabbed.index ? grabbed.at : p)) : still;
  let finish;
  // The map stays where it is under a corner that moves.
  [, view, finish] = fieldOn(map, shown, walking ? [] : field.keep_outs ?? [], walking ? 0 : field.gap_m, still);
  if (walking) context.clearRect(0, 0, map.width, map.height);
  if (!walking) {
    for (const side of field.plan?.sides ?? []) stroke(context, side, "#fff", 2);
    finish();
    if (field.walked) stroke(context, field.walked, "#ffd54a", 3);
    handles(context, shown);
    if (drawn.length) stroke(context, drawn, "#c62828", 6);
  } else stroke(context, field.walk.track, "#0a2f7a", 6);
  if (field.here) {
    const [u, v] = view.at(field.here);
    context.beginPath();
    context.arc(u, v, 12, 0, 7);
    context.fillStyle = "#0a58ff";
    context.fill();
    context.lineWidth = 4;
    context.strokeStyle = "#fff";
    context.stroke();
  }
}

// Numbers where there is room for them; a boundary as it was walked has points nearer to each other.
function handles(context, shown) {
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
    context.lineWidth = 3;
    context.strokeStyle = "#000";
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
  const mine = !world.now?.driven || world.now.driver;
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
}

function set(id, text) { if ($(id).textContent !== text) $(id).textContent = text; }
