// Places on a map that a keyboard can take hold of: one button each, laid over the canvas. A finger
// and a mouse go through them to the map itself.
const STEP_M = 0.1, STRIDE_M = 1;
const WAYS = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

// `on`: what is done with the handle of a number: move by metres east and north, press, drop, add,
// leave, focus and blur.
export function bind(box, on) {
  const numbered = (event) => [...box.children].indexOf(event.target);
  box.addEventListener("keydown", (event) => {
    const way = WAYS[event.key], step = event.shiftKey ? STRIDE_M : STEP_M;
    const deed = way ? "move" : { Delete: "drop", Backspace: "drop", Insert: "add", "+": "add", Escape: "leave" }[event.key];
    if (!deed || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    on[deed]?.(numbered(event), ...(way ?? []).map((one) => one * step));
  });
  for (const [kind, deed] of [["click", "press"], ["focusin", "focus"], ["focusout", "blur"]]) box.addEventListener(kind, (event) => on[deed]?.(numbered(event)));
}

// Buttons that are there already stay, and with them the focus.
export function lay(box, canvas, places, names) {
  while (box.children.length < places.length) box.append(Object.assign(document.createElement("button"), { type: "button", className: "handle" }));
  const focused = box.contains(document.activeElement);
  while (box.children.length > places.length) box.lastElementChild.remove();
  places.forEach(([u, v], k) => {
    const one = box.children[k];
    one.style.left = `${100 * u / canvas.width}%`;
    one.style.top = `${100 * v / canvas.height}%`;
    if (one.getAttribute("aria-label") !== names[k]) one.setAttribute("aria-label", names[k]);
  });
  if (focused && !box.contains(document.activeElement)) box.lastElementChild?.focus();
}
