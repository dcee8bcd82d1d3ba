// What was tracked, how it went, and with which settings, from summary.json.
import { element } from "pardalis/dom.js";
import { number, seconds } from "pardalis/format.js";

/** Fills an element with a summary (null: there is none) and notes about the page, such as that rows were left out. */
export function showSummary(host, summary, notes = []) {
  host.replaceChildren(...notes.map((note) => element("p", { class: "pv-note" }, note)));
  if (!summary) return;
  host.append(element("div", { class: "pv-summary" }, section("Run", facts(run(summary))), section("Targets", targets(summary), ...doubts(summary), ...notFound(summary)), section("Cameras", cameras(summary))));
  if (summary.settings) {
    host.append(element("details", { class: "pv-settings" }, element("summary", {}, "Settings"), element("pre", {}, JSON.stringify(summary.settings, null, 2))));
  }
}

function run(summary) {
  const time = summary.time ?? {};
  const sets = summary.frame_sets;
  const each = (total_s) => (sets > 0 && Number.isFinite(total_s) ? `${number((1000 * total_s) / sets, 2)} ms per frame set` : "–");
  const end = summary.error ?? (summary.interrupted ? "interrupted" : summary.limit_reached ? "its limit was reached" : "all frames were tracked");
  return [
    ["scene", summary.scene],
    ["frame sets", sets],
    ["ended", end],
    ...(summary.smoothed ? [["smoothed", "yes: each row also takes account of what came after it"]] : []),
    ["tracking", each(time.tracking_s)],
    ["waiting for frames", seconds(time.waiting_for_frames_s)],
    ["seed", summary.seed],
    ["threads", summary.threads],
    ["version", `${summary.program ?? "pardalis"} ${summary.version ?? ""}`],
  ];
}

function targets(summary) {
  const states = ["tracking", "occluded", "lost", "searching"];
  const rows = Object.entries(summary.targets ?? {}).map(([name, target]) => {
    const counts = states.map((state) => target.rows?.[state] ?? 0);
    const all = counts.reduce((a, b) => a + b, 0);
    return [name, ...counts, all > 0 ? `${number((100 * counts[0]) / all, 1)} %` : "–"];
  });
  return table(["target", ...states, "tracked"], rows);
}

function cameras(summary) {
  const rows = Object.entries(summary.cameras ?? {}).map(([name, camera]) => {
    const frames = camera.frames ?? {};
    return [name, camera.source?.input ?? "", frames.delivered, frames.used, frames.dropped_late, frames.overtaken, frames.frozen];
  });
  return table(["camera", "input", "frames", "used", "late", "overtaken", "frozen"], rows);
}

/** For each target that was missing in some frames, where and why: the first sentence says where. */
function notFound(summary) {
  const all = Object.values(summary.targets ?? {}).map((target) => target.not_found ?? []);
  return all.filter((sentences) => sentences.length > 0).map(([where, ...why]) =>
    element("div", { class: "pv-missed" }, element("p", {}, where), element("ul", {}, ...why.map((sentence) => element("li", {}, sentence)))));
}

/** What some words mean that are no common ones. */
const EXPLAINED = {
  "frame sets": "images of all cameras at one time, or nearly so",
  seed: "where the random numbers began: with the same one, the same recording gives the same results",
  threads: "how much was computed at once",
  late: "came after later images had been tracked, and were left out",
  overtaken: "live images that were left out because tracking was slower than the camera",
  frozen: "the same, byte for byte, as the image before",
};

/** What is doubtful where targets were tracked. */
function doubts(summary) {
  const all = Object.entries(summary.targets ?? {}).flatMap(([name, target]) => (target.doubts ?? []).map((sentence) => `${name}: ${sentence}`));
  return all.length > 0 ? [element("ul", { class: "pv-missed" }, ...all.map((sentence) => element("li", {}, sentence)))] : [];
}

function explained(word) {
  return EXPLAINED[word] ? element("abbr", { title: EXPLAINED[word] }, word) : word;
}

function section(title, ...content) {
  return element("section", {}, element("h2", {}, title), ...content);
}

function facts(pairs) {
  return element("dl", {}, ...pairs.flatMap(([name, value]) => [element("dt", {}, explained(name)), element("dd", {}, String(value ?? "–"))]));
}

function table(heads, rows) {
  const body = rows.map((cells) => element("tr", {}, ...cells.map((cell, at) => element(at === 0 ? "th" : "td", {}, String(cell ?? "–")))));
  return element("div", { class: "pv-table" }, element("table", {}, element("thead", {}, element("tr", {}, ...heads.map((head) => element("th", { scope: "col" }, explained(head))))), element("tbody", {}, ...body)));
}
