// The field on a canvas: what is cut, what stands, the fence, the machine and where it goes next.
import { t } from "./texts.js";

const BLADE_AHEAD_M = 1.5;
const BLADE_M = 1.0;

function viewOf(points, canvas, room) {
  const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
  const [x0, x1, y0, y1] = [Math.min(...xs) - room, Math.max(...xs) + room, Math.min(...ys) - room, Math.max(...ys) + room];
  const scale = Math.min(canvas.width / (x1 - x0), canvas.height / (y1 - y0));
  const left = (canvas.width - (x1 - x0) * scale) / 2, top = (canvas.height - (y1 - y0) * scale) / 2;
  return {
    scale,
    at: ([x, y]) => [left + (x - x0) * scale, canvas.height - top - (y - y0) * scale],
    back: (u, v) => [(u - left) / scale + x0, (canvas.height - top - v) / scale + y0],
  };
}

function path(context, view, ring, closed = true) {
  context.beginPath();
  ring.forEach((p, k) => { const [u, v] = view.at(p); if (k) context.lineTo(u, v); else context.moveTo(u, v); });
  if (closed) context.closePath();
}

function scaleBar(context, view, canvas) {
  const length = [1, 2, 5, 10, 20, 50, 100, 200].findLast((one) => one * view.scale < canvas.width / 3) ?? 1;
  context.fillStyle = "#000";
  context.fillRect(16, canvas.height - 22, length * view.scale, 6);
  context.font = "bold 22px sans-serif";
  context.textAlign = "left";
  context.fillText(t("metres", { metres: length }), 16, canvas.height - 30);
}

export function fieldOn(canvas, boundary, keepOuts, gap, within = boundary) {
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  const view = viewOf(within, canvas, Math.max(2, (gap ?? 0) + 1));
  if (gap) {
    path(context, view, boundary);
    context.lineJoin = "miter";
    context.lineWidth = 2 * gap * view.scale;
    context.strokeStyle = "#d9d9d9";
    context.stroke();
  }
  path(context, view, boundary);
  context.fillStyle = "#2e7d32";
  context.fill();
  return [context, view, () => {
    for (const hole of keepOuts) { path(context, view, hole); context.fillStyle = "#c62828"; context.fill(); context.lineWidth = 3; context.strokeStyle = "#000"; context.stroke(); }
    path(context, view, boundary);
    context.lineWidth = 4;
    context.strokeStyle = "#000";
    context.stroke();
    scaleBar(context, view, canvas);
  }];
}

export function drawMap(canvas, world) {
  const plan = world.plan ?? world.field?.plan;
  const context = canvas.getContext("2d");
  if (!plan?.boundary?.length) {
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.fillStyle = "#000";
    context.font = "bold 30px sans-serif";
    context.textAlign = "center";
    context.fillText(t("map.none"), canvas.width / 2, canvas.height / 2);
    return;
  }
  const [, view, finish] = fieldOn(canvas, plan.boundary, plan.keep_outs, plan.gap_m);
  context.save();
  path(context, view, plan.boundary);
  context.clip();
  context.fillStyle = "#e6c86e";
  for (const strip of plan.cut ?? world.goal?.cut ?? []) { path(context, view, strip); context.fill(); }
  context.strokeStyle = "#e6c86e";
  context.lineWidth = BLADE_M * view.scale;
  context.lineCap = "butt";
  let last = null;
  context.beginPath();
  for (const [x, y, yaw] of world.trail) {
    const here = [x + BLADE_AHEAD_M * Math.cos(yaw), y + BLADE_AHEAD_M * Math.sin(yaw)];
    const [u, v] = view.at(here);
    if (last && Math.hypot(here[0] - last[0], here[1] - last[1]) < 0.8) context.lineTo(u, v); else context.moveTo(u, v);
    last = here;
  }
  context.stroke();
  context.restore();
  finish();
  const pilot = world.now?.pilot;
  const index = pilot ? Math.max(0, plan.sides.length - (pilot.sides - pilot.side + 1)) : 0;
  context.setLineDash([14, 8]);
  context.lineWidth = 5;
  context.strokeStyle = "#000";
  for (const side of plan.sides.slice(index, index + 2)) { path(context, view, side, false); context.stroke(); }
  context.setLineDash([]);
  if (plan.sides[index]) {
    const side = plan.sides[index], middle = side.length >> 1;
    arrow(context, view.at(side[middle - 1]), view.at(side[middle]));
  }
  const idle = !pilot;
  if (idle && world.goal && world.ended?.resume) goalAt(context, view, world.goal.place);
  if (idle && world.field?.here) {
    context.beginPath();
    context.arc(...view.at(world.field.here), 12, 0, 7);
    context.fillStyle = "#0a58ff";
    context.fill();
    context.lineWidth = 4;
    context.strokeStyle = "#fff";
    context.stroke();
  }
  if (pilot?.place) machine(context, view, pilot.place);
}

function arrow(context, [u0, v0], [u1, v1]) {
  const angle = Math.atan2(v1 - v0, u1 - u0);
  const [u, v] = [(u0 + u1) / 2, (v0 + v1) / 2];
  context.beginPath();
  context.moveTo(u + 18 * Math.cos(angle), v + 18 * Math.sin(angle));
  context.lineTo(u + 14 * Math.cos(angle + 2.4), v + 14 * Math.sin(angle + 2.4));
  context.lineTo(u + 14 * Math.cos(angle - 2.4), v + 14 * Math.sin(angle - 2.4));
  context.fillStyle = "#000";
  context.fill();
}

// Where the machine has to stand to go on: its outline, the blade's right end on the crop's edge.
function goalAt(context, view, [x, y, yaw]) {
  const point = (forward, left) => view.at([x + (forward - BLADE_AHEAD_M) * Math.cos(yaw) - (left + BLADE_M / 2) * Math.sin(yaw), y + (forward - BLADE_AHEAD_M) * Math.sin(yaw) + (left + BLADE_M / 2) * Math.cos(yaw)]);
  context.beginPath();
  [point(-0.3, 0.45), point(1.1, 0.45), point(BLADE_AHEAD_M, 0), point(1.1, -0.45), point(-0.3, -0.45)].forEach(([u, v], k) => (k ? context.lineTo(u, v) : context.moveTo(u, v)));
  context.closePath();
  for (const [style, width] of [["#fff", 9], ["#b8001c", 5]]) { context.setLineDash([12, 7]); context.strokeStyle = style; context.lineWidth = width; context.stroke(); }
  context.setLineDash([]);
}

function machine(context, view, [x, y, yaw]) {
  const point = (forward, left) => view.at([x + forward * Math.cos(yaw) - left * Math.sin(yaw), y + forward * Math.sin(yaw) + left * Math.cos(yaw)]);
  context.beginPath();
  [point(-0.3, 0.45), point(1.1, 0.45), point(1.1, -0.45), point(-0.3, -0.45)].forEach(([u, v], k) => (k ? context.lineTo(u, v) : context.moveTo(u, v)));
  context.closePath();
  context.fillStyle = "#0a2f7a";
  context.fill();
  context.lineWidth = 3;
  context.strokeStyle = "#fff";
  context.stroke();
  context.beginPath();
  context.moveTo(...point(BLADE_AHEAD_M, BLADE_M / 2));
  context.lineTo(...point(BLADE_AHEAD_M, -BLADE_M / 2));
  context.lineWidth = 8;
  context.strokeStyle = "#b8001c";
  context.stroke();
}

export function mapSaid(world) {
  const pilot = world.now?.pilot;
  return pilot?.done != null ? t("map.said", { percent: Math.round(pilot.done * 100), side: pilot.side, sides: pilot.sides }) : t("map.label");
}
