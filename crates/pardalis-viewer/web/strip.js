// The states of all targets over time, one row each.
import { onThemeChange, theme } from "pardalis/colors.js";
import { runSwatch } from "pardalis/comparison.js";
import { css, element, setPressed } from "pardalis/dom.js";
import { roundStep, timeTick } from "pardalis/format.js";

const ROW_PX = 18;
const AXIS_PX = 20;

export class Strip {
  /** `pick(time_s)` is called when the user clicks on a time, `select(name)` when on a target. */
  constructor(host, pick, select) {
    this.select = select;
    this.names = element("div", { class: "pv-strip-names" });
    this.canvas = element("canvas", { class: "pv-strip-canvas", role: "img", "aria-label": "States over time", onclick: (event) => pick(this.#timeAt(event.offsetX)) });
    this.marker = element("div", { class: "pv-marker" });
    this.area = element("div", { class: "pv-strip-area" }, this.canvas, this.marker);
    this.host = element("div", { class: "pv-strip" }, this.names, this.area);
    host.append(this.host);
    this.resizes = new ResizeObserver(() => this.draw());
    this.resizes.observe(this.area);
    this.stopThemes = onThemeChange(() => this.draw());
  }

  /** Shows the states in a run and, if two are compared, in a second one: a row for each of both. */
  setTracks(runs, selected) {
    this.runs = runs;
    const names = new Set(runs.flatMap((tracks) => [...tracks.all.keys()]));
    this.rows = [...names].flatMap((name) => runs.map((tracks, run) => ({ name, run, track: tracks.all.get(name) })));
    const key = JSON.stringify([[...names], runs.length]);
    if (this.key !== key) {
      this.key = key;
      this.names.replaceChildren(...this.rows.map(({ name, run }) =>
        element("button", { type: "button", title: name, onclick: () => this.select(name) }, runs.length > 1 ? runSwatch(run) : "", name)));
    }
    [...this.names.children].forEach((button, row) => setPressed(button, this.rows[row].name === selected));
    this.pending ??= requestAnimationFrame(() => {
      this.pending = undefined;
      this.draw();
    });
  }

  setTime(time_s) {
    this.time_s = time_s;
    const left = this.#x(time_s);
    this.marker.style.display = Number.isFinite(left) ? "block" : "none";
    this.marker.style.transform = `translateX(${left.toFixed(1)}px)`;
  }

  draw() {
    const { canvas } = this;
    const width = this.area.clientWidth;
    if (!this.rows || width === 0) return;
    const height = this.rows.length * ROW_PX + AXIS_PX;
    const scale = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    canvas.style.height = `${height}px`;
    const paint = canvas.getContext("2d");
    paint.scale(scale, scale);
    let top = 0;
    for (const { track, run } of this.rows) {
      paint.fillStyle = css(this.host, "--pv-track");
      paint.fillRect(0, top + 2, width, ROW_PX - 4);
      for (const { state, from_s, to_s } of track ? stretches(track, this.runs[run].step()) : []) {
        paint.fillStyle = theme().states[state];
        const [left, right] = [this.#x(from_s), this.#x(to_s)];
        // Low bars for what is not seen: states differ without colours, too.
        const share = [0.25, 1, 0.62, 0.4][state];
        paint.fillRect(left, top + 2 + (1 - share) * (ROW_PX - 4), Math.max(1, right - left), share * (ROW_PX - 4));
      }
      top += ROW_PX;
    }
    this.#axis(paint, width, top);
    if (this.time_s !== undefined) this.setTime(this.time_s);
  }

  #axis(paint, width, top) {
    const [first, last] = this.#span();
    const step = roundStep(last - first, Math.max(2, width / 110));
    paint.fillStyle = css(this.host, "--pv-muted");
    paint.font = "11px system-ui, sans-serif";
    paint.textBaseline = "top";
    for (let at = Math.ceil(first / step); at * step <= last; at++) {
      const text = timeTick(at * step, step);
      const x = this.#x(at * step);
      paint.textAlign = x < 20 ? "left" : x > width - 20 ? "right" : "center";
      paint.fillText(text, x, top + 5);
    }
  }

  #span() {
    const spans = this.runs.map((tracks) => [tracks.times[0] ?? 0, (tracks.times.at(-1) ?? 1) + tracks.step()]);
    return [Math.min(...spans.map(([first]) => first)), Math.max(...spans.map(([, last]) => last))];
  }

  #x(time_s) {
    if (!this.runs) return NaN;
    const [first, last] = this.#span();
    return ((time_s - first) / (last - first)) * this.area.clientWidth;
  }

  #timeAt(x) {
    const [first, last] = this.#span();
    return first + (x / this.area.clientWidth) * (last - first);
  }

  dispose() {
    cancelAnimationFrame(this.pending);
    this.resizes.disconnect();
    this.stopThemes();
  }
}

/** Returns the stretches of rows in one state, without those where there are no rows. */
function* stretches(track, step_s) {
  let from = 0;
  for (let row = 1; row <= track.length; row++) {
    const isGap = row < track.length && track.time_s[row] - track.time_s[row - 1] > 5 * step_s;
    if (row < track.length && !isGap && track.state[row] === track.state[from]) continue;
    const to_s = row < track.length && !isGap ? track.time_s[row] : track.time_s[row - 1] + step_s;
    yield { state: track.state[from], from_s: track.time_s[from], to_s };
    from = row;
  }
}
