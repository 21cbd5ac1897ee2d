// Sounds by WebAudio: no file, and audible with the page in the pocket. Browsers allow them after
// the first touch only.
let context = null;

export function wake() {
  context ??= new (window.AudioContext || window.webkitAudioContext)();
  if (context.state === "suspended") context.resume();
}

function tone(from, length, frequency, kind = "square", loud = 0.35) {
  if (!context) return;
  const start = context.currentTime + from;
  const source = context.createOscillator();
  const volume = context.createGain();
  source.type = kind;
  source.frequency.value = frequency;
  volume.gain.setValueAtTime(loud, start);
  volume.gain.setValueAtTime(loud, start + length - 0.02);
  volume.gain.linearRampToValueAtTime(0, start + length);
  source.connect(volume).connect(context.destination);
  source.start(start);
  source.stop(start + length);
  window.dispatchEvent(new CustomEvent("tone", { detail: frequency }));
}

export const stopped = () => { tone(0, 0.5, 440); tone(0.6, 0.5, 440); };
export const fault = () => { for (let k = 0; k < 4; k++) { tone(k * 0.5, 0.22, 980); tone(k * 0.5 + 0.25, 0.22, 620); } };
export const second = (last) => tone(0, last ? 0.6 : 0.15, last ? 1320 : 880, "sine");
export const waiting = () => { tone(0, 0.2, 660, "sine"); tone(0.3, 0.2, 520, "sine"); };
export const finished = () => { [523, 659, 784, 1047].forEach((f, k) => tone(k * 0.18, 0.17, f, "sine")); };
