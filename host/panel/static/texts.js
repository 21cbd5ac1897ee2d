// The texts of one language; a page is told keys, and says them here.
let texts = {};
let patterns = null;     // sentences with places to fill: [expression, key]
export let language = "en";
export const LANGUAGES = ["en", "ur"];

// Whether they came.
export async function load(code) {
  try { texts = await (await fetch(`texts/${code}.json`)).json(); } catch { return false; }
  patterns = null;
  language = code;
  document.documentElement.lang = code;
  document.documentElement.dir = code === "ur" ? "rtl" : "ltr";
  try { localStorage.setItem("language", code); } catch { /* private browsing */ }
  for (const one of document.querySelectorAll("[data-t]")) one.textContent = t(one.dataset.t);
  for (const one of document.querySelectorAll("[data-label]")) one.setAttribute("aria-label", t(one.dataset.label));
  return true;
}

export const has = (key) => key in texts;

export function t(key, values = {}) {
  let text = texts[key] ?? key;
  for (const [name, value] of Object.entries(values)) text = text.replaceAll(`{${name}}`, isolate(value));
  return text;
}

// Figures keep their own direction inside a right-to-left sentence.
const isolate = (value) => (language === "ur" ? `\u2068${show(value)}\u2069` : show(value));
const show = (value) => (typeof value === "number" ? String(Math.round(value * 1000) / 1000) : String(value ?? "?"));

// A value that is a name of texts is said in the page's language; the rest is a figure or a sentence.
export const words = (value) => (Array.isArray(value) ? value.map(words).join("; ") : typeof value !== "string" ? value : has(value) ? t(value) : said(value));
export const filled = (key, values) => t(key, Object.fromEntries(Object.entries(values ?? {}).map(([name, value]) => [name, words(value)])));

// Why the pilot does what it does, by the reason's code.
export const reason = (of) => (of.code && has(`reason.${of.code}`) ? filled(`reason.${of.code}`, of.words) : said(of.reason ?? ""));

// What the pilot and the devices say is English; where the language knows the sentence, it is said in it.
export function said(sentence) {
  if (has(`said.${sentence}`)) return t(`said.${sentence}`);
  patterns ??= Object.keys(texts).filter((key) => key.startsWith("said.") && key.includes("{")).map((key) => [pattern(key.slice(5)), key]);
  for (const [expression, key] of patterns) {
    const found = expression.exec(sentence);
    if (found) return filled(key, found.groups);
  }
  return sentence;
}

const pattern = (sentence) => new RegExp(`^${sentence.split(/\{(\w+)\}/).map((part, k) => (k % 2 ? `(?<${part}>.*)` : part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"))).join("")}$`, "s");
