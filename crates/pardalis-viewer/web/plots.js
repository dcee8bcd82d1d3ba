// Plots over time of one target: positions with a band of two standard deviations, velocities, confidence, heading.
import uPlot from "uplot";
import { onThemeChange, theme } from "pardalis/colors.js";
import { css, element } from "pardalis/dom.js";
import { lengthDecimals, number, tick, timeTick } from "pardalis/format.js";
import { Track } from "pardalis/tracks.js";

const HEIGHT_PX = 132;
const GUTTER_PX = 58;

/** The dashes of the lines of a second run, in pixels. */
const DASH = [6, 4];

/** A live track redraws its plots at most this often, in milliseconds. */
const PAUSE_MS = 150;

/** What is plotted: title, column, unit, the column of its variance or standard deviation, and the range that is shown at least. */
function kinds(units) {
  const axis = (letter, number) => [
    { title: letter, column: `${letter}_m`, unit: units, variance: `${letter}${letter}_m2`, color: number, span: units === "px" ? 4 : 0.02, decimals: lengthDecimals(units) },
    { title: `v${letter}`, column: `v${letter}_mps`, unit: `${units}/s`, variance: `v${letter}${letter}_m2ps2`, optional: true, color: number, span: units === "px" ? 4 : 0.1, decimals: 2 },
  ];
  return [
    ..."xyz".split("").flatMap(axis),
    { title: "confidence", column: "confidence", unit: "", color: 3, range: [0, 1], decimals: 2 },
    { title: "heading", column: "heading_rad", unit: "°", sigma: "sigma_heading_rad", factor: 180 / Math.PI, color: 3, span: 10, decimals: 1, optional: true },
  ];
}

export class Plots {
  /** `pick(time_s)` is called when the user clicks on a time. */
  constructor(host, pick) {
    this.host = host;
    this.pick = pick;
    this.plots = [];
    this.tracks = [];
    this.units = "m";
    this.resizes = new ResizeObserver(() => this.#resize());
    this.resizes.observe(host);
    this.stopThemes = onThemeChange(() => this.#rebuild());
  }

  /** Plots other tracks: of a target in a run, and in a second one if two are compared; none where there is none. */
  setTracks(tracks, units) {
    this.tracks = tracks.some(Boolean) ? tracks.map((track) => track ?? new Track("")) : [];
    this.units = units;
    this.#rebuild();
  }

  #rebuild() {
    this.#clear();
    for (const kind of this.#kinds()) this.plots.push(this.#create(kind));
    this.#mark();
  }

  /** What there is to be plotted. */
  #kinds() {
    if (this.tracks.length === 0) return [];
    return kinds(this.units).filter((kind) => !kind.optional || this.tracks.some((track) => track.has(kind.column)));
  }

  /** Plots rows that have been added. */
  refresh() {
    this.waiting ??= setTimeout(() => {
      this.waiting = undefined;
      const isNew = this.#kinds().some((kind) => !this.plots.some((plot) => plot.kind.column === kind.column));
      if (isNew) this.#rebuild();
      else for (const { kind, plot } of this.plots) plot.setData(columnsOf(this.tracks, kind), !this.isZoomed);
      this.#mark();
    }, PAUSE_MS);
  }

  /** Marks a time. */
  setTime(time_s) {
    this.time_s = time_s;
    this.#mark();
  }

  #create(kind) {
    const color = kind.color < 3 ? theme().axes[kind.color] : css(this.host, "--pv-ink");
    const colors = this.tracks.length > 1 ? theme().runs : [color];
    const value = element("span", { class: "pv-plot-value" });
    const figure = element("figure", { class: "pv-plot" },
      element("figcaption", {}, element("b", { style: `color: ${color}` }, kind.title), kind.unit && ` (${kind.unit})`, value));
    this.host.append(figure);
    const marker = element("div", { class: "pv-marker" });
    const edge = { stroke: "transparent", width: 0, points: { show: false }, spanGaps: false };
    const hasBand = kind.variance || kind.sigma;
    const series = colors.flatMap((stroke, run) => [
      ...(hasBand ? [{ ...edge }, { ...edge }] : []),
      { stroke, width: 1.6, dash: run > 0 ? DASH : undefined, points: { show: false }, paths: linePath },
    ]);
    const bands = colors.map((stroke, run) => ({ series: [3 * run + 2, 3 * run + 1], fill: stroke + (colors.length > 1 ? "24" : "38") }));
    const axis = { stroke: css(this.host, "--pv-muted"), grid: { stroke: css(this.host, "--pv-line"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const plot = new uPlot({
      width: this.#width(),
      height: HEIGHT_PX,
      padding: [8, 12, 0, 0],
      legend: { show: false },
      cursor: { y: false, points: { show: false }, sync: { key: this.#key(), setSeries: false } },
      scales: { x: { time: false }, y: { range: kind.range ? () => [-0.04, 1.04] : (_, low, high) => spanned(low, high, kind.span) } },
      axes: [
        { ...axis, size: 24, gap: 3, values: (_, ticks) => ticks.map((at) => timeTick(at, ticks[1] - ticks[0] || Math.abs(at) || 1)) },
        { ...axis, size: GUTTER_PX, gap: 4, values: (_, ticks) => ticks.map((at) => tick(at, ticks[1] - ticks[0] || Math.abs(at) || 1)) },
      ],
      series: [{}, ...series],
      bands: hasBand ? bands : [],
      hooks: {
        ready: [(made) => this.#listen(made, marker)],
        setScale: [(made, scale) => scale === "x" && this.#followZoom(made)],
        setSize: [() => this.#mark()],
      },
    }, columnsOf(this.tracks, kind), figure);
    return { kind, plot, figure, marker, value };
  }

  #key() {
    this.syncKey ??= `pardalis-${Math.random()}`;
    return this.syncKey;
  }

  #listen(plot, marker) {
    plot.over.append(marker);
    let pressedAt = NaN;
    plot.over.addEventListener("mousedown", (event) => (pressedAt = event.clientX));
    plot.over.addEventListener("click", (event) => {
      if (Math.abs(event.clientX - pressedAt) < 3) this.pick(plot.posToVal(event.offsetX, "x"));
    });
  }

  /** All plots show the same time. */
  #followZoom(from) {
    // Plots that have been replaced report their scale late.
    if (this.isFollowing || !this.plots.some(({ plot }) => plot === from)) return;
    this.isFollowing = true;
    const { min, max } = from.scales.x;
    const [first, last] = [from.data[0][0], from.data[0].at(-1)];
    this.isZoomed = min > first || max < last;
    for (const { plot } of this.plots) {
      if (plot !== from && (plot.scales.x.min !== min || plot.scales.x.max !== max)) plot.setScale("x", { min, max });
    }
    this.isFollowing = false;
    queueMicrotask(() => this.#mark());
  }

  #mark() {
    const rows = this.tracks.map((track) => (this.time_s === undefined ? -1 : track.rowAt(this.time_s)));
    for (const { kind, plot, marker, value } of this.plots) {
      const left = plot.valToPos(this.time_s, "x");
      const isInside = left >= 0 && left <= plot.over.clientWidth;
      marker.style.display = isInside ? "block" : "none";
      if (isInside) marker.style.transform = `translateX(${left.toFixed(1)}px)`;
      const values = rows.map((row, run) => (row < 0 ? "" : number(this.tracks[run][kind.column][row] * (kind.factor ?? 1), kind.decimals)));
      value.textContent = values.some(Boolean) ? values.map((text) => text || number(NaN)).join(" · ") : "";
    }
  }

  #width() {
    const columns = getComputedStyle(this.host).gridTemplateColumns.split(" ").length;
    const gap = parseFloat(getComputedStyle(this.host).columnGap) || 0;
    return Math.max(200, Math.floor((this.host.clientWidth - gap * (columns - 1)) / columns));
  }

  #resize() {
    const width = this.#width();
    for (const { plot } of this.plots) {
      if (plot.width !== width) plot.setSize({ width, height: HEIGHT_PX });
    }
    this.#mark();
  }

  #clear() {
    clearTimeout(this.waiting);
    this.waiting = undefined;
    for (const { plot, figure } of this.plots) {
      plot.destroy();
      figure.remove();
    }
    this.plots = [];
    this.isZoomed = false;
  }

  dispose() {
    this.#clear();
    this.resizes.disconnect();
    this.stopThemes();
  }
}

/** Returns times, and of each track the values, after the edges of the band if there is one. Missing values are null, which leaves a gap; at times of others undefined, which leaves none. */
function columnsOf(tracks, kind) {
  const tables = tracks.map((track) => columnsOfOne(track, kind));
  return tables.length > 1 ? uPlot.join(tables) : tables[0];
}

function columnsOfOne(track, { column, variance, sigma, factor = 1 }) {
  const [times, values, highs, lows] = [[], [], [], []];
  for (let row = 0; row < track.length; row++) {
    const value = track[column][row] * factor;
    const isThere = Number.isFinite(value);
    times.push(track.time_s[row]);
    values.push(isThere ? value : null);
    if (!variance && !sigma) continue;
    const two = 2 * factor * (variance ? Math.sqrt(Math.max(0, track[variance][row])) : track[sigma][row]);
    const hasBand = isThere && Number.isFinite(two);
    highs.push(hasBand ? value + two : null);
    lows.push(hasBand ? value - two : null);
  }
  return variance || sigma ? [times, lows, highs, values] : [times, values];
}

/** A line that is not there where values are missing, however short the gap: the lines of uPlot cross gaps of a few pixels. */
function linePath(plot, series, first, last) {
  const [times, values] = [plot.data[0], plot.data[series]];
  const stroke = new Path2D();
  let [lastX, lastY] = [NaN, NaN];
  for (let row = first; row <= last; row++) {
    if (values[row] === undefined) continue;
    if (values[row] === null) {
      lastX = NaN;
      continue;
    }
    const [x, y] = [plot.valToPos(times[row], "x", true), plot.valToPos(values[row], "y", true)];
    if (Number.isNaN(lastX)) {
      // A single value between gaps is a dot.
      stroke.moveTo(x - 0.5, y);
    } else if (Math.abs(x - lastX) < 0.5 && Math.abs(y - lastY) < 0.5) {
      continue;
    }
    stroke.lineTo(x, y);
    [lastX, lastY] = [x, y];
  }
  return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 0 };
}

/** A range that is at least this long, with a margin. */
function spanned(low, high, span) {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [0, 1];
  const missing = Math.max(0, span - (high - low)) / 2;
  const margin = 0.06 * Math.max(span, high - low);
  return [low - missing - margin, high + missing + margin];
}

