// Two runs of the same recording: their main figures, and what differs.
import { theme } from "pardalis/colors.js";
import { element } from "pardalis/dom.js";
import { instant, number, shortLength, signed } from "pardalis/format.js";

/** Returns the line by which a run is known: solid for the first, dashed for the second. */
export function runSwatch(run) {
  return element("i", { class: "pv-run", style: `border-top: 2.5px ${run > 0 ? "dashed" : "solid"} ${theme().runs[run]}` });
}

export class ComparisonTable {
  /** `pick(time_s)` is called when the user wants to see a time. */
  constructor(host, pick) {
    this.host = host;
    this.pick = pick;
    host.hidden = true;
  }

  /** Shows how a target differs between two runs; see viewer.js. Null: there is one run. */
  show(comparison, selected, units) {
    this.host.hidden = !comparison;
    if (!comparison) return;
    const target = comparison.targets[selected];
    const figures = (target?.figures ?? [null, null]).map((run) => columns(run, units));
    const heads = ["run", ...figures[0].map(({ name }) => name)].map((text) => element("th", { scope: "col" }, text));
    const order = comparison.other_is_earlier ? [1, 0] : [0, 1];
    const rows = order.map((run) => {
      const name = comparison.names[run];
      return row([runSwatch(run), element("span", { title: name }, name)], figures[run].map(({ value, format }) => format(value)));
    });
    const [from, to] = order.map((run) => figures[run]);
    const differences = to.map(({ value, format }, at) => signed(value - from[at].value, format));
    const table = element("table", {}, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...rows, row(["change"], differences)));
    this.host.replaceChildren(element("h2", {}, `Two runs: ${selected ?? ""}`), element("div", { class: "pv-table" }, table), this.#distance(target?.distance, units), ...settings(comparison.settings ?? [], order));
  }

  #distance(distance, units) {
    if (!distance) return element("p", { class: "pv-distance" }, "There is no time at which both see it.");
    const { times, median_m, largest_m, largest_at_s } = distance;
    const show = element("button", { type: "button", title: "Show this time", onclick: () => this.pick(largest_at_s) }, instant(largest_at_s));
    return element("p", { class: "pv-distance" }, "Distance between both: median ", element("b", {}, shortLength(median_m, units)),
      ", largest ", element("b", {}, shortLength(largest_m, units)), " at ", show, `, of ${times} times`);
  }
}

function columns(run, units) {
  const count = (value) => number(value, 0);
  const length = (value) => shortLength(value, units);
  // A state without rows is not listed.
  const states = ["tracking", "occluded", "lost", "searching"].map((state) => ({ name: state, value: run ? (run.rows[state] ?? 0) : NaN, format: count }));
  return [
    ...states,
    { name: "confidence", value: run?.mean_confidence ?? NaN, format: (value) => number(value, 3) },
    { name: "median σ", value: run?.median_sigma_m ?? NaN, format: length },
  ];
}

function row(head, cells) {
  return element("tr", {}, element("th", { scope: "row" }, ...head), ...cells.map((cell) => element("td", {}, cell)));
}

/** The settings that differ, as lines, with their values in both runs in this order. */
function settings(list, [from, to]) {
  if (list.length === 0) return [];
  const text = (value) => value ?? "not set";
  const lines = list.map(({ key, values }) => element("li", {}, element("code", {}, key), ` ${text(values[from])} → ${text(values[to])}`));
  return [element("details", { class: "pv-differ", open: "" }, element("summary", {}, "Settings that differ"), element("ul", {}, ...lines))];
}
