// Sliders for the paper's colours, and the steering loop's tuning with its plot.
import { t, said } from "./texts.js";

const $ = (id) => document.getElementById(id);
let ask = () => {};
let params = null;
let begun = false;
let sliders = [];
let timer = 0;
let pid = null;

export function bind(asker) {
  ask = asker;
  $("colour-look").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "colour_take" }); });
  $("colour-best").addEventListener("click", () => { ask({ do: "take" }); say(t("tune.searching")); ask({ do: "colour_best", params }); });
  $("colour-save").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "colour_save", params }); });
  $("pid-go").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "pid" }); });
}

export function hear(message) {
  if (message.error) { say(said(message.error)); return; }
  if (message.sliders) { sliders = message.sliders; make(); }
  if (message.params) { params = message.params; set(); }
  if (message.image) { $("colour-picture").src = message.image; $("colour-picture").alt = t("tune.picture"); }
  if (message.saved) say(t("tune.saved"));
  else if (message.confidence != null) say(t("tune.confidence", { confidence: message.confidence }));
  else if (message.contrast != null) say(t("tune.contrast", { contrast: message.contrast }));
}

function set() { for (const one of document.querySelectorAll("#sliders input")) { one.value = params[one.name]; label(one); } }

// In another language.
export function speak() {
  make();
  if (params) set();
  say("");
  draw();
}

function say(text) { $("colour-said").textContent = text; }
function label(input) { input.previousElementSibling.lastElementChild.textContent = input.value; }

function make() {
  $("sliders").replaceChildren(...sliders.flatMap((slider) => {
    const input = document.createElement("input");
    Object.assign(input, { type: "range", name: slider.name, id: `slider-${slider.name}`, min: slider.min, max: slider.max, step: slider.step });
    const text = document.createElement("label");
    text.htmlFor = input.id;
    const value = document.createElement("bdi");
    text.append(`${t(`slider.${slider.name}`)}: `, value);
    input.addEventListener("input", () => {
      params = { ...params, [slider.name]: Number(input.value) };
      label(input);
      clearTimeout(timer);
      timer = setTimeout(() => ask({ do: "colour_look", params }), 120);
    });
    return [text, input];
  }));
}

export function hearPid(message) { pid = message; draw(); }

function draw() {
  if (!pid) return;
  const text = pid.problem ? said(pid.problem) : t("tune.pid.said", { kp: pid.kp, ki: pid.ki, kd: pid.kd, overshoot: pid.overshoot_deg, rise: pid.rise_s });
  if ($("pid-said").textContent !== text) $("pid-said").textContent = text;
  const canvas = $("pid-plot"), context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  const all = [...(pid.asked ?? []), ...(pid.got ?? [])];
  if (!all.length) return;
  const tMax = Math.max(...all.map((p) => p[0])), low = Math.min(...all.map((p) => p[1]), 0) - 2, high = Math.max(...all.map((p) => p[1])) + 2;
  const at = ([s, a]) => [60 + s / tMax * (canvas.width - 120), canvas.height - 40 - (a - low) / (high - low) * (canvas.height - 60)];
  context.font = "bold 20px sans-serif";
  context.fillStyle = "#000";
  context.textAlign = "right";
  for (let a = Math.ceil(low / 10) * 10; a <= high; a += 10) { const [u, v] = at([0, a]); context.fillText(`\u2066${a}°\u2069`, u - 8, v + 7); context.fillStyle = "#bbb"; context.fillRect(u, v, canvas.width - 120, 1); context.fillStyle = "#000"; }
  context.textAlign = "center";
  // The unit stands at the last figure alone: in some languages it is a long word.
  const last = Math.floor(tMax);
  for (let s = 0; s <= last; s++) { const [u] = at([s, low]); context.fillText(s === last ? t("seconds", { seconds: s }) : String(s), u, canvas.height - 12); }
  for (const [points, colour, dash] of [[pid.asked, "#000", [10, 6]], [pid.got, "#b8001c", []]]) {
    context.setLineDash(dash);
    context.lineWidth = 4;
    context.strokeStyle = colour;
    context.beginPath();
    points.forEach((p, k) => { const [u, v] = at(p); if (k) context.lineTo(u, v); else context.moveTo(u, v); });
    context.stroke();
  }
  context.setLineDash([]);
}

export function show(world) {
  const mine = !world.now?.driven || world.now.driver;
  // Who only looks takes the wheel from nobody.
  if (!begun && world.now?.driver) begun = ask({ do: "colour_begin" });
  const idle = world.now?.mode === "idle";
  for (const id of ["colour-look", "colour-best", "colour-save"]) $(id).disabled = !mine || !idle;
  $("pid-go").disabled = !mine || !idle || Boolean(world.now?.link.problem);
  $("pid-plot").setAttribute("aria-label", t("tune.pid.plot"));
}
