// The list that the machine walks itself: what was seen, what was expected, what to do.
import { t, filled } from "./texts.js";

const $ = (id) => document.getElementById(id);
let ask = () => {};
let found = null;

export function bind(asker) {
  ask = asker;
  $("check-go").addEventListener("click", () => { ask({ do: "take" }); ask({ do: "check" }); });
}

function row(line) {
  const item = document.createElement("li");
  item.dataset.verdict = line.verdict;
  item.dataset.line = line.name;
  item.dataset.finding = line.finding;
  const head = document.createElement("b");
  head.append(t(`line.${line.name}`), " ", t(`verdict.${line.verdict}`));
  item.append(head);
  if (line.finding) {
    const seen = document.createElement("span");
    seen.textContent = filled(`found.${line.finding}`, line.values);
    item.append(seen);
  }
  const expected = document.createElement("small");
  expected.textContent = `${t("check.expected")} ${filled(`expected.${line.name}`, line.values)}`;
  item.append(expected);
  if (line.verdict === "bad" || line.verdict === "warn") {
    const todo = document.createElement("span");
    todo.className = "todo";
    todo.textContent = `${t("check.todo")} ${filled(`todo.${line.finding}`, line.values)}`;
    item.append(todo);
  }
  return item;
}

export function hear(message) {
  found = message;
  $("check-lines").replaceChildren(...message.lines.map(row));
  const question = message.question;
  $("question").hidden = !question;
  if (question) {
    const key = JSON.stringify(question);
    if ($("question").dataset.key !== key) {
      $("question").dataset.key = key;
      $("question").dataset.question = question.key;
      $("question-text").textContent = t(`ask.${question.key}`, question.values ?? {});
      $("question-drawing").innerHTML = drawings[question.key] ?? "";
      $("question-choices").replaceChildren(...(question.number ? [number(question)] : question.choices.map((choice) => {
        const button = document.createElement("button");
        button.className = "main";
        button.dataset.choice = choice;
        button.textContent = t(`answer.${choice}`);
        button.addEventListener("click", () => ask({ do: "answer", id: question.id, answer: choice }));
        return button;
      })));
      $("question").scrollIntoView({ block: "center" });
    }
  } else delete $("question").dataset.key;
}

// In another language.
export function speak() {
  delete $("question").dataset.key;
  if (found) hear(found);
}

function number(question) {
  const form = document.createElement("form");
  const input = document.createElement("input");
  input.type = "number";
  input.step = "0.01";
  input.inputMode = "decimal";
  input.dir = "ltr";
  input.setAttribute("aria-label", t(`ask.${question.key}`, question.values ?? {}));
  const button = document.createElement("button");
  button.className = "main";
  button.textContent = t("answer.done");
  form.append(input, button);
  form.addEventListener("submit", (event) => { event.preventDefault(); if (input.value !== "") ask({ do: "answer", id: question.id, answer: Number(input.value) }); });
  return form;
}

export function show(world) {
  const running = world.now?.mode === "check";
  $("check-go").disabled = running || !world.now || (world.now.driven && !world.now.driver) || world.now.mode !== "idle";
  const bad = found?.lines.filter((line) => line.verdict === "bad").length ?? 0;
  const text = running ? t("check.running") : !found?.done ? t("check.never") : found.green ? t("check.green") : t("check.red", { count: bad });
  if ($("check-outcome").textContent !== text) $("check-outcome").textContent = text;
}

// Drawings for questions whose words are long: the machine from above, x forward is up.
const body = '<rect x="-14" y="-2" width="28" height="44" rx="3" fill="#fff" stroke="#000" stroke-width="3"/><rect x="-24" y="26" width="8" height="20" fill="#000"/><rect x="16" y="26" width="8" height="20" fill="#000"/>';
const svg = (inner) => `<svg viewBox="-60 -60 120 120" aria-hidden="true">${inner}</svg>`;
const wheel = (angle, dash) => `<g transform="translate(0 -12) rotate(${angle})"><rect x="-4" y="-11" width="8" height="22" fill="${dash ? "none" : "#000"}" stroke="#000" stroke-width="2" ${dash ? 'stroke-dasharray="3 3"' : ""}/></g>`;
const drawings = {
  steered: svg(`${body}${wheel(-30)}${wheel(30, 1)}<text x="-50" y="-30" font-size="12">◀</text><text x="38" y="-30" font-size="12">▶</text>`),
  rolled: svg(`${body}${wheel(0)}<path d="M40 10V-40M40 -40l-7 10M40 -40l7 10" stroke="#000" stroke-width="4" fill="none"/><path d="M-40 -10V40M-40 40l-7 -10M-40 40l7 -10" stroke="#000" stroke-width="4" fill="none" stroke-dasharray="4 4"/>`),
  rolled_m: svg(`${body}${wheel(0)}<path d="M36 -50V46M28 -50h16M28 46h16" stroke="#000" stroke-width="3"/><text x="44" y="2" font-size="13">?</text>`),
  room: svg(`${body}${wheel(0)}<path d="M-20 -26V-56h40V-26" fill="none" stroke="#004d25" stroke-width="3" stroke-dasharray="5 4"/>`),
  estop_press: svg('<circle r="34" fill="#ffd54a" stroke="#000" stroke-width="3"/><circle r="20" fill="#b8001c" stroke="#000" stroke-width="3"/><path d="M0 -58V-26M0 -24l-8 -10M0 -24l8 -10" stroke="#000" stroke-width="5" fill="none"/>'),
  estop_release: svg('<circle r="34" fill="#ffd54a" stroke="#000" stroke-width="3"/><circle r="20" fill="#b8001c" stroke="#000" stroke-width="3"/><path d="M-26 -38a46 46 0 0 1 52 0M26 -38l-12 1M26 -38l-4 -11" stroke="#000" stroke-width="5" fill="none"/>'),
};
