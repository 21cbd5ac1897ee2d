// The field: walked with the phone in the hand, mended with a finger, planned at once.
import { t, said } from "./texts.js";
import { fieldOn } from "./map.js";

const $ = (id) => document.getElementById(id);
let ask = () => {};
let field = null;
let view = null;
let tool = null;      // "move", "keep_out" or null
let grabbed = null;   // the corner that moves, or the keep-out's corners so far
let drawn = [];
let map = null;

export function bind(asker) {
  ask = asker;
  map = $("field-map");
  $("walk-begin").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "walk_begin" }); });
  $("walk-end").addEventListener("click", () => ask({ do: "walk_end" }));
  $("walk-drop").addEventListener("click", () => ask({ do: "walk_drop" }));
  $("field-move").addEventListener("click", () => choose("move"));
  $("field-keep-out").addEventListener("click", () => {
    if (tool === "keep_out" && drawn.length > 2) ask({ do: "keep_out", ring: drawn });
    choose("keep_out");
  });
  $("field-keep-out-drop").addEventListener("click", () => { drawn = []; ask({ do: "keep_out_drop" }); });
  $("field-gap").addEventListener("change", () => { const gap = Number($("field-gap").value); if (gap >= 0) { ask({ do: "take" }); ask({ do: "gap", gap_m: gap }); } });
  $("field-corner").addEventListener("change", () => { ask({ do: "take" }); ask({ do: "corner", corner: Number($("field-corner").value) }); });
  $("field-file").addEventListener("change", () => { ask({ do: "take" }); ask({ do: "open", name: $("field-file").value }); });
  map.addEventListener("pointerdown", begin);
  map.addEventListener("pointermove", move);
  map.addEventListener("pointerup", end);
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
  if (distances[nearest] * view.scale < 60) { grabbed = nearest; map.setPointerCapture(event.pointerId); }
}

function move(event) {
  if (grabbed === null) return;
  field.boundary[grabbed] = place(event);
  draw();
}

function end() {
  if (grabbed === null) return;
  const [x, y] = field.boundary[grabbed];
  ask({ do: "move_corner", index: grabbed, x, y });
  grabbed = null;
}

export function hear(message) {
  field = structuredClone(message);
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
  if (grabbed !== null && view) { drawField(context, boundary); return; }
  drawField(context, walked.length > 1 && field.walk.on ? walked : boundary);
}

function drawField(context, shown) {
  const walking = field.walk?.on && field.walk.track.length > 1;
  let finish;
  [, view, finish] = fieldOn(map, shown, walking ? [] : field.keep_outs ?? [], walking ? 0 : field.gap_m);
  if (walking) context.clearRect(0, 0, map.width, map.height);
  if (!walking) {
    for (const side of field.plan?.sides ?? []) stroke(context, [[side[0], side[1]], [side[2], side[3]]], "#fff", 2);
    finish();
    context.font = "bold 26px sans-serif";
    context.textAlign = "center";
    shown.forEach((p, k) => {
      const [u, v] = view.at(p);
      context.beginPath();
      context.arc(u, v, 17, 0, 7);
      context.fillStyle = k === field.corner ? "#0a2f7a" : "#fff";
      context.fill();
      context.lineWidth = 3;
      context.strokeStyle = "#000";
      context.stroke();
      context.fillStyle = k === field.corner ? "#fff" : "#000";
      context.fillText(String(k + 1), u, v + 9);
    });
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
  const walked = walk?.on ? t("field.walk.now", { fixes: walk.fixes, length: Math.round(walk.length_m), back: Math.round(walk.back_m), laps: walk.laps }) : "";
  set("walk-said", !walk?.on && walk?.said ? said(walk.said) : "");
  set("field-said", walked || (field?.problem ? said(field.problem) : field?.boundary ? t("field.said", { corners: field.boundary.length, area: Math.round(field.area_m2), keep_outs: field.keep_outs.length }) : ""));
  const sum = field?.summary;
  set("plan-said", sum ? t("plan.said", { sides: sum.sides, turns: sum.turns, minutes: Math.max(1, Math.round(sum.seconds / 60)), length: Math.round(sum.length_m), left: sum.leftover_m2 }) : t("plan.none"));
  $("field-map").setAttribute("aria-label", t("map.label"));
}

function set(id, text) { if ($(id).textContent !== text) $(id).textContent = text; }
