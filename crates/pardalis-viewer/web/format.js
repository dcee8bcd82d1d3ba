// Numbers as text, with their units.

const MISSING = "–";

/** Returns a number with this many decimals; a dash if there is none. A true minus, and no "-0.000". */
export function number(value, decimals) {
  if (!Number.isFinite(value)) return MISSING;
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? "−" + text : text;
}

/** The decimals of lengths in these units: millimetres, or tenths of a pixel. */
export function lengthDecimals(units) {
  return units === "px" ? 1 : 3;
}

/** Returns a length with its unit. */
export function length(value, units) {
  return number(value, lengthDecimals(units)) + (Number.isFinite(value) ? " " + units : "");
}

/** Returns twice a standard deviation given as a variance, such as "12 mm"; empty without one. */
export function twoSigma(variance, units) {
  return variance >= 0 ? shortLength(2 * Math.sqrt(variance), units) : "";
}

/** Returns a length in metres, or millimetres if it is short; a dash if there is none. */
export function shortLength(value, units) {
  if (!Number.isFinite(value)) return MISSING;
  if (units === "px") return `${number(value, 1)} px`;
  if (Math.abs(value) >= 1) return `${number(value, 2)} m`;
  return `${number(1000 * value, Math.abs(value) < 0.01 ? 1 : 0)} mm`;
}

/** Returns a difference as a text with its sign, unless it rounds to zero; `format` gives the text of a number. */
export function signed(difference, format) {
  const text = format(difference);
  return difference > 0 && /[1-9]/.test(text) ? "+" + text : text;
}

/** Returns a time in seconds. */
export function seconds(value) {
  return number(value, 3) + " s";
}

/** Returns round steps of about a `count`-th of a span: 1, 2 or 5 times a power of ten. */
export function roundStep(span, count) {
  const rough = Math.max(span / count, 1e-12);
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((factor) => factor * power >= 0.999 * rough) ?? 10);
}

/** Returns a number in as few digits as a step between numbers needs. */
export function tick(value, step) {
  let decimals = 0;
  while (decimals < 9 && Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) > 1e-6 * step * 10 ** decimals) decimals++;
  return number(value, decimals);
}
