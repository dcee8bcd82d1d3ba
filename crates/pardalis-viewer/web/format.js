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

/** Points in time later than this count from long ago, such as those of live cameras: since 1970. */
const LONG_AGO_S = 1e6;

/** The point in time that is shown as 0 s. */
let origin_s = 0;

/** Shows points in time that count from long ago since the first one, in whole seconds. Returns what 0 s then stands for; null if that is what it says. */
export function setOrigin(first_s) {
  origin_s = first_s > LONG_AGO_S ? Math.floor(first_s) : 0;
  if (origin_s === 0) return null;
  const is1970 = origin_s > 1e8;
  return is1970 ? new Date(1000 * origin_s).toISOString().replace("T", " ").replace(".000Z", " UTC") : `${origin_s} s`;
}

/** Returns a point in time. */
export function instant(time_s) {
  return seconds(time_s - origin_s);
}

/** Returns a tick of an axis of points in time, this far from the next one. */
export function timeTick(time_s, step_s) {
  // Differences of numbers as large as seconds since 1970 are not round.
  return tick(time_s - origin_s, Number(step_s.toPrecision(4))) + " s";
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
