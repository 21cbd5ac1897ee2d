// The camera's picture with the crop's edge as the machine sees it (E_outer) and where it should be.
import { t } from "./texts.js";

// `old`: what it shows is over.
export function drawPicture(canvas, bitmap, now, old) {
  const context = canvas.getContext("2d");
  if (!bitmap) {
    say(context, canvas, "#222", t("picture.waiting"));
    return;
  }
  const [width, height] = now?.camera?.size ?? [bitmap.width, bitmap.height];
  canvas.width = width;
  canvas.height = height;
  context.drawImage(bitmap, 0, 0, width, height);
  if (old) { say(context, canvas, "#222c", t("picture.old")); return; }
  const view = now?.pilot?.view;
  if (!view || view.confidence < 0.5) return;
  if (view.o_map_px != null) line(context, [[view.o_map_px, height * 0.75], [view.o_map_px, height]], "#fff", 3);
  if (view.edge_px.length > 1) line(context, view.edge_px, "#ff2d2d", 5);
  else if (view.e_outer_px != null) line(context, [[view.e_outer_px, height * 0.75], [view.e_outer_px, height]], "#ff2d2d", 5);
}

function say(context, canvas, shade, text) {
  context.fillStyle = shade;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.fillStyle = "#fff";
  context.font = "bold 28px sans-serif";
  context.textAlign = "center";
  context.fillText(text, canvas.width / 2, canvas.height / 2);
}

function line(context, points, colour, width) {
  for (const [style, extra] of [["#000", 4], [colour, 0]]) {
    context.beginPath();
    points.forEach(([u, v], k) => (k ? context.lineTo(u, v) : context.moveTo(u, v)));
    context.lineWidth = width + extra;
    context.strokeStyle = style;
    context.stroke();
  }
}
