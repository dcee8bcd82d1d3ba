// Elements. Texts are set as text, never as HTML: names come from files of strangers.

/** Returns an element with these attributes (`class`, `aria-…`), properties (functions: listeners by their `on…` name) and children (elements, texts). */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made[name] = value;
    // Pages of servers may allow no attributes with styles.
    else if (name === "style") made.style.cssText = value;
    else if (value !== undefined && value !== false) made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

/** Returns the value of a CSS variable, such as a colour. */
export function css(of, name) {
  return getComputedStyle(of).getPropertyValue(name).trim();
}

/** Shows whether a choice is taken, also to screen readers. */
export function setPressed(button, isPressed) {
  button.setAttribute("aria-pressed", String(isPressed));
}
