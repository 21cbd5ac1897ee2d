// The last runs with their report, the language, and how the laptop keeps up.
import { t, reason, language } from "./texts.js";

const $ = (id) => document.getElementById(id);
let runs = [];

export function hear(message) {
  runs = message.runs;
  $("runs").replaceChildren(...(runs.length ? runs.map(card) : [paragraph(t("runs.none"))]));
}

function paragraph(text) { const p = document.createElement("p"); p.textContent = text; return p; }

// By the clock of whoever reads it.
const when = (begun) => new Intl.DateTimeFormat(`${language}-u-nu-latn`, { dateStyle: "medium", timeStyle: "short" }).format(new Date(begun));

function card(run) {
  const box = document.createElement("article");
  const head = document.createElement("b");
  head.textContent = `${when(run.begun)} — ${t(`outcome.${run.outcome}`)}`;
  box.append(head, paragraph(reason(run)), paragraph(t("runs.said", { minutes: Math.round(run.seconds / 6) / 10, turns: run.turns, pictures: run.pictures, slow: run.slow_steps, late: run.late_steps })));
  for (const fault of run.faults) box.append(paragraph(`${t(`fault.${fault}`)}: ${t(`remedy.${fault}`)}`));
  const file = paragraph(run.record);
  file.dir = "ltr";
  file.className = "small";
  box.append(file);
  return box;
}

export function languages(codes, current, speak) {
  $("languages").replaceChildren(...codes.map((code) => {
    const button = document.createElement("button");
    button.textContent = { en: "English", ur: "اردو" }[code];
    button.lang = code;
    button.setAttribute("aria-pressed", String(code === current));
    button.addEventListener("click", () => speak(code));
    return button;
  }));
}

export function show(world) {
  const now = world.now;
  if (!now) return;
  const rows = [["inside.pages", now.pages], ["inside.firmware", now.link.firmware ?? t("unknown")], ["inside.port", now.link.port]];
  if (now.steps) rows.push(["inside.steps", `${now.steps.slow} / ${now.steps.count}`], ["inside.longest", t("milliseconds", { ms: now.steps.longest_ms })]);
  const list = $("inside");
  const key = JSON.stringify([rows, document.documentElement.lang]);
  if (list.dataset.shown === key) return;
  list.dataset.shown = key;
  list.replaceChildren(...rows.flatMap(([name, value]) => {
    const dt = document.createElement("dt"); dt.textContent = t(name);
    const dd = document.createElement("dd"); dd.textContent = value; dd.dir = "ltr";
    return [dt, dd];
  }));
}
