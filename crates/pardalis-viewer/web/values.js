// The numbers at the present time: of the selected target in full, and a table of all if there are several.
import { theme } from "pardalis/colors.js";
import { element } from "pardalis/dom.js";
import { instant, length, lengthDecimals, number, shortLength, twoSigma } from "pardalis/format.js";
import { STATES } from "pardalis/tracks.js";

export class Values {
  /** `select(name)` is called when the user picks a target. */
  constructor(host, select) {
    this.select = select;
    this.facts = element("dl", { class: "pv-facts", "aria-label": "Values at the present time" });
    this.axes = element("tbody");
    const [axis, position, two, speed, twoOfSpeed] = ["", "position", "± 2σ", "", "± 2σ"].map((text) => element("th", { scope: "col" }, text));
    this.velocityHead = speed;
    this.velocityHead.title = "velocity";
    this.vectors = element("table", { class: "pv-vectors" }, element("thead", {}, element("tr", {}, axis, position, two, speed, twoOfSpeed)), this.axes);
    this.body = element("tbody");
    const heads = ["target", "x", "y", "z", "speed"].map((text) => element("th", { scope: "col" }, text));
    this.heads = element("tr", {}, ...heads);
    this.table = element("div", { class: "pv-all", tabindex: "0", "aria-label": "All targets" }, element("table", {}, element("thead", {}, this.heads), this.body));
    host.append(element("div", { class: "pv-panel" }, this.facts, this.vectors), this.table);
    this.rows = new Map();
  }

  /** Shows the values at a time that rows have, of a frame of this number, and the distance to the selected target in a second run if two are compared. */
  show([tracks, other], selected, time_s, frame, units) {
    this.#showFacts(tracks.all.get(selected), other?.all.get(selected), time_s, frame, units);
    this.table.hidden = tracks.all.size < 2;
    if (!this.table.hidden) this.#showAll(tracks, selected, time_s, units);
  }

  #showFacts(track, other, time_s, frame, units) {
    const row = track ? track.rowAt(time_s) : -1;
    const at = (column) => (row < 0 ? NaN : track[column][row]);
    const state = row < 0 ? null : track.state[row];
    const dot = state === null ? "" : element("i", { class: "pv-dot", style: `background: ${theme().states[state]}` });
    const facts = [["time", Number.isFinite(frame) ? `frame ${frame}` : "", instant(time_s)]];
    if (track) facts.push(["state", dot, state === null ? "not there" : STATES[state]]);
    facts.push(["confidence", "", number(at("confidence"), 3)]);
    if (other) facts.push(["runs apart", "", shortLength(apart(track, other, time_s), units)]);
    const speed = Math.hypot(at("vx_mps"), at("vy_mps"), at("vz_mps"));
    const speedSigma = speedDeviation(at, speed);
    facts.push(["speed", Number.isFinite(speedSigma) ? `± ${number(2 * speedSigma, 2)}` : "", unit(number(speed, 2), `${units}/s`)]);
    if (Number.isFinite(at("heading_rad"))) {
      const degrees = (radians) => number((radians * 180) / Math.PI, 1) + "°";
      const sigma = at("sigma_heading_rad");
      facts.push(["heading", Number.isFinite(sigma) ? `± ${degrees(2 * sigma)}` : "", degrees(at("heading_rad"))]);
    }
    if (Number.isFinite(at("radius_m"))) facts.push(["radius", `± ${twoSigma(at("sigma_radius_m") ** 2, units)}`, length(at("radius_m"), units)]);
    this.facts.replaceChildren(...facts.map(([name, more, value]) => element("div", { "data-value": name },
      element("dt", {}, name), element("dd", { class: "pv-more" }, more), element("dd", {}, value))));
    // Its unit in every row would leave no room for the numbers.
    this.velocityHead.textContent = `v, ${units}/s`;
    const axes = ["x", "y", "z"].map((axis) => element("tr", { "data-value": axis },
      element("th", { scope: "row" }, axis),
      element("td", {}, length(at(`${axis}_m`), units)),
      element("td", { class: "pv-more" }, Number.isFinite(at(`${axis}_m`)) ? twoSigma(at(`${axis}${axis}_m2`), units) : ""),
      element("td", {}, number(at(`v${axis}_mps`), 2)),
      element("td", { class: "pv-more" }, twoSigmaOf(at(`v${axis}${axis}_m2ps2`)))));
    this.axes.replaceChildren(...axes);
  }

  #showAll(tracks, selected, time_s, units) {
    const decimals = lengthDecimals(units);
    for (const [name, row] of this.rows) {
      if (tracks.all.has(name)) continue;
      row.tr.remove();
      this.rows.delete(name);
    }
    for (const track of tracks.all.values()) {
      if (!this.rows.has(track.name)) this.rows.set(track.name, this.#addRow(track.name));
      const { tr, dot, cells } = this.rows.get(track.name);
      const row = track.rowAt(time_s);
      tr.className = row < 0 ? "pv-absent" : "";
      tr.setAttribute("aria-selected", String(track.name === selected));
      dot.style.background = row < 0 ? "transparent" : theme().states[track.state[row]];
      dot.title = row < 0 ? "not there" : STATES[track.state[row]];
      const at = (column) => (row < 0 ? NaN : track[column][row]);
      const speed = Math.hypot(at("vx_mps"), at("vy_mps"), at("vz_mps"));
      const texts = [number(at("x_m"), decimals), number(at("y_m"), decimals), number(at("z_m"), decimals), number(speed, 2)];
      texts.forEach((text, column) => (cells[column].textContent = text));
    }
  }

  #addRow(name) {
    const dot = element("i", { class: "pv-dot" });
    const cells = Array.from({ length: 4 }, () => element("td"));
    const button = element("button", { type: "button", onclick: () => this.select(name) }, dot, name);
    const tr = element("tr", {}, element("th", { scope: "row" }, button), ...cells);
    this.body.append(tr);
    return { tr, dot, cells };
  }
}

/** Returns the distance between a target in two runs at a time; NaN unless both have a position. */
function apart(track, other, time_s) {
  const [here, there] = [track, other].map((one) => {
    const row = one ? one.rowAt(time_s) : -1;
    return row < 0 ? null : one.position(row);
  });
  return here && there ? Math.hypot(...here.map((component, axis) => component - there[axis])) : NaN;
}

/** Twice the standard deviation of a velocity with this variance; nothing if there is none. */
function twoSigmaOf(variance) {
  return variance >= 0 ? number(2 * Math.sqrt(variance), 2) : "";
}

/** The standard deviation of the speed: that of the velocity along itself. NaN where it is not known, as of a target at rest. */
function speedDeviation(at, speed) {
  const [x, y, z] = ["vx_mps", "vy_mps", "vz_mps"].map((column) => at(column) / speed);
  const [xx, xy, xz, yy, yz, zz] = ["xx", "xy", "xz", "yy", "yz", "zz"].map((entry) => at(`v${entry}_m2ps2`));
  return Math.sqrt(xx * x * x + yy * y * y + zz * z * z + 2 * (xy * x * y + xz * x * z + yz * y * z));
}

/** A number with its unit, unless there is none. */
function unit(text, units) {
  return text === number(NaN) ? text : `${text} ${units}`;
}
