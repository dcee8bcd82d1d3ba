// Colours that colour-blind people can distinguish (Okabe and Ito), for light and dark backgrounds.

const DARK = window.matchMedia("(prefers-color-scheme: dark)");

const LIGHT_THEME = {
  states: ["#8a8f98", "#0072b2", "#e69f00", "#cc5f98"],
  axes: ["#d55e00", "#009e73", "#0072b2"],
  targets: ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"],
  runs: ["#0072b2", "#d55e00"],
  grid: "#d4d8de",
  camera: "#5b6470",
  ground: "#f4f6f8",
};

const DARK_THEME = {
  states: ["#7d8590", "#56b4e9", "#f0b429", "#e58fc0"],
  axes: ["#ff8a4c", "#2cc295", "#56b4e9"],
  targets: ["#56b4e9", "#ff8a4c", "#2cc295", "#e58fc0", "#9ad1f5", "#f0b429"],
  runs: ["#56b4e9", "#ff8a4c"],
  grid: "#333a44",
  camera: "#9aa4b2",
  ground: "#14181d",
};

/** The colours of the present theme: of states by code, of axes, of targets by number, of two runs that are compared. */
export function theme() {
  return DARK.matches ? DARK_THEME : LIGHT_THEME;
}

/** Calls a function when the theme changes, until the returned function is called. */
export function onThemeChange(changed) {
  DARK.addEventListener("change", changed);
  return () => DARK.removeEventListener("change", changed);
}

// Cividis (Nuñez, Anderton and Renslow 2018), from its dark to its light end, without the darkest part.
const CONFIDENCES = [[33, 69, 126], [87, 93, 109], [125, 124, 120], [166, 157, 117], [211, 193, 98], [254, 232, 56]];

/** Returns the colour of a confidence from 0 to 1, as three numbers from 0 to 1 in sRGB. */
export function confidenceColor(confidence) {
  const place = Math.min(1, Math.max(0, confidence || 0)) * (CONFIDENCES.length - 1);
  const below = Math.min(Math.floor(place), CONFIDENCES.length - 2);
  return CONFIDENCES[below].map((low, channel) => {
    const high = CONFIDENCES[below + 1][channel];
    return (low + (place - below) * (high - low)) / 255;
  });
}

/** A CSS gradient of the confidences. */
export const CONFIDENCE_GRADIENT = `linear-gradient(to right, ${CONFIDENCES.map((rgb) => `rgb(${rgb.join(" ")})`).join(", ")})`;
