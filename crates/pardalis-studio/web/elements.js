// Elements of the page. Texts come from files and scenes of strangers: they become text, never markup.

/** Makes an element. Attributes that begin with "on" are listeners; `null` and `false` children and attributes are left out. */
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value") element.value = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(9).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Makes a button. */
export function button(text, onclick, attributes = {}) {
  return el("button", { type: "button", onclick, ...attributes }, text);
}

/** Makes a field with its name above it and, if given, a hint below it. */
export function field(name, input, hint = null) {
  if (input.type === "number") selectAtFirst(input);
  return el("label", { class: "field" }, el("span", {}, name), input, hint && el("small", {}, hint));
}

/** Selects what is in a field at the click that goes to it, to be typed over. */
export function selectAtFirst(input) {
  let isNew = false;
  input.addEventListener("focus", () => { isNew = true; });
  input.addEventListener("click", () => {
    if (isNew) input.select();
    isNew = false;
  });
}

/** What people have opened or closed, by its id. */
const opened = new Map();

/** Makes a part that people open and close, and that stays so when it is made anew. */
export function disclosure(id, title, children, isOpen = false) {
  // The event `toggle` comes only after the click, and there may be another element by then.
  const summary = el("summary", { onclick: () => opened.set(id, !details.open) }, title);
  const details = el("details", { id, open: opened.get(id) ?? isOpen }, summary, children);
  return details;
}

/** Makes a choice among values, `[value, text]` each. */
export function choice(options, value, onchange, attributes = {}) {
  const select = el("select", { onchange: () => onchange(select.value), ...attributes });
  for (const [option, text] of options) select.append(el("option", { value: option, selected: option === value }, text));
  return select;
}

/** Formats a number with this many decimals; a dash if there is none. */
export function fixed(value, decimals) {
  return Number.isFinite(value) ? value.toFixed(decimals).replace(/^-(0\.?0*)$/, "$1") : "–";
}

/** Formats a point in time: of live cameras, which count from 1970, as the time of the day. */
export function instant(time_s) {
  return time_s > 1e8 ? `${new Date(1000 * time_s).toISOString().slice(11, 22)} UTC` : `${fixed(time_s, 2)} s`;
}

/** For how long after it was let go something counts as pressed, unless its click comes before. */
const RELEASE_MS = 60;

/** What is pressed now, and whether something around it was not replaced because of it. */
let pressed = null;
let isStale = false;
/** What makes everything anew. */
let renew = () => {};

/** Sets what is called when something was let go around which nothing could be replaced. */
export function onRelease(callback) {
  renew = callback;
}

function release() {
  pressed = null;
  if (isStale) {
    isStale = false;
    renew();
  }
}

const isKey = (event) => event.key === " ";
addEventListener("pointerdown", ({ target }) => { pressed = target; }, true);
addEventListener("keydown", (event) => { if (isKey(event)) pressed = event.target; }, true);
for (const event of ["pointercancel", "dragend", "blur"]) addEventListener(event, release);
// After the event `change` of a tick, which comes after its click.
addEventListener("click", () => setTimeout(release), true);
// A choice in a list has no click. What was typed in a field changes when something else is pressed.
addEventListener("change", ({ target }) => { if (target === pressed) release(); });
// A click comes after these, of a finger a little later; nothing does if the pointer has moved away.
addEventListener("pointerup", () => setTimeout(release, RELEASE_MS), true);
addEventListener("keyup", (event) => { if (isKey(event)) setTimeout(release, RELEASE_MS); }, true);
addEventListener("pointermove", ({ buttons }) => { if (pressed && buttons === 0) setTimeout(release, RELEASE_MS); }, true);

/**
 * Replaces the children of an element and keeps the focus, and what is being typed, in the element of the same id. While one of them is pressed, they stay: a click is lost if
 * its element is not there at the end.
 */
export function replaceChildren(parent, ...children) {
  if (pressed !== parent && parent.contains(pressed)) {
    isStale = true;
    return;
  }
  const active = parent.contains(document.activeElement) ? document.activeElement : null;
  const { id, value } = active ?? {};
  const isTyped = active?.matches("input:not([type=range]):not([type=checkbox])");
  const [start, end] = isTyped && active.type === "text" ? [active.selectionStart, active.selectionEnd] : [null, null];
  parent.replaceChildren(...children.flat(9).filter(Boolean));
  const again = id && document.getElementById(id);
  if (!again) return;
  if (isTyped && value !== active.defaultValue) again.value = value;
  again.focus();
  if (start !== null) again.setSelectionRange(start, end);
}
