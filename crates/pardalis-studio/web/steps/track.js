// Step 6: the run.

import { MEANINGS } from "pardalis/tracks.js";
import { ask } from "../connection.js";
import { button, disclosure, el, fixed, instant } from "../elements.js";
import { drawMarks } from "../picture.js";
import { compareControl, settingsControl } from "./compare.js";
import { hasLive, recordControl, recordedText, recordingControl, records } from "./record.js";
import { canReplay, replayBar, replayedNow, updateReplay } from "./replay.js";

/** How often rows are fetched while the viewer is shown. */
const FETCH_MS = 200;

/** Whether the viewer is shown in place of the pictures; it, and the number of the next row. */
let isViewer = false;
let viewer = null;
let next = 0;
let fetching = null;

/** Whether the track of the next run is smoothed, and whether a page of it is written. */
let isSmooth = false;
let isPaged = false;

/** Whether frames of recordings are shown again, in place of the last images of the run. */
let isReplay = false;

/** The earlier run that the last one is compared with, by its number, and what came of it; whether one is to be chosen at the end of the run. */
let other = null;
let comparison = null;
let choosesLast = false;
/** The number of the last earlier run when the run began. */
let kept = 0;

/** When values came last, or the run began, in milliseconds of this page, and after how many seconds without new ones the page says so. */
let told_ms = performance.now();
const SILENT_S = 2;
let timer = null;

async function compareWith(app, number) {
  const answer = await app.change("compare", { run: number });
  if (!answer) return app.render();
  other = number;
  comparison = number === null ? null : answer;
  if (comparison) isViewer = true;
  viewer?.setComparison(comparison);
  app.render();
}

/** Begins a run. The one before it will be compared with it. */
function start(app) {
  choosesLast = Boolean(app.state.run);
  kept = app.state.run?.earlier?.at(-1)?.number ?? 0;
  return app.change("track", { record: records(app), smooth: isSmooth && !hasLive(app), page: isPaged && !hasLive(app) });
}

function chooseLast(app) {
  const { goes_on: goes, earlier } = app.state.run ?? {};
  const last = earlier?.at(-1);
  // Until the run has begun, the state is that of the one before it.
  if (!choosesLast || goes || !last || last.number === kept) return;
  choosesLast = false;
  setTimeout(compareWith, 0, app, last.number);
}

/** Shows the viewer with the rows so far, and keeps fetching those that come. */
async function openViewer(app, host) {
  closeViewer();
  const { Viewer } = await import("pardalis/viewer.js");
  if (!host.isConnected) return;
  viewer = new Viewer(host);
  const scene = app.latest.get("scene");
  if (scene) viewer.setScene(scene);
  if (comparison) viewer.setComparison(comparison);
  next = 0;
  fetching = setTimeout(fetchRows, 0, app, viewer);
}

async function fetchRows(app, shown) {
  let pause_ms = FETCH_MS;
  try {
    const rows = await ask("rows", { from: next });
    if (shown !== viewer) return;
    if (rows.next > next || rows.first > next) {
      viewer.append(rows.targets, rows.cameras);
      // More may be waiting.
      pause_ms = 0;
    }
    next = rows.next;
  } catch {
    // The page says that the program does not answer.
    pause_ms = 2000;
  }
  if (shown === viewer) fetching = setTimeout(fetchRows, pause_ms || 20, app, shown);
}

function closeViewer() {
  clearTimeout(fetching);
  viewer?.dispose();
  viewer = null;
}

const COLORS = { tracking: "good", occluded: "fair", lost: "bad", searching: "fair" };

function targetRow({ name, state, confidence, position_m: at, sigma_m: sigma }) {
  const meter = el("meter", { min: 0, max: 1, low: 0.3, high: 0.7, optimum: 1, value: confidence, "aria-label": "Confidence" });
  const axes = ["x", "y", "z"].map((axis, i) => el("tr", {}, el("th", { scope: "row" }, axis), el("td", {}, fixed(at?.[i], 3)), el("td", {}, sigma ? `± ${fixed(2000 * sigma[i], 0)} mm` : "")));
  return el(
    "section",
    { class: "target", "data-target": name },
    el("h3", {}, name, " ", el("span", { class: `state ${COLORS[state] ?? ""}`, title: MEANINGS[state] }, state)),
    el("p", { class: "confidence" }, meter, ` ${Math.round(100 * confidence)} % certain`),
    el("table", {}, el("thead", {}, el("tr", {}, ["", "in m", "± 2σ"].map((head) => el("th", { scope: "col" }, head)))), axes),
  );
}

function histogram({ limits, counts }, isLive) {
  const most = Math.max(...counts, 1);
  const total = counts.reduce((sum, count) => sum + count, 0);
  const upTo = (i) => (limits[i] === undefined ? `above ${limits.at(-1)}` : `up to ${limits[i]}`);
  let [sum, half] = [0, 0];
  counts.forEach((count, i) => {
    if (sum < total / 2) half = i;
    sum += count;
  });
  const bars = counts.map((count, i) => {
    const bar = el("span", { title: `${upTo(i)} ms: ${count}` });
    bar.style.height = `${(100 * count) / most}%`;
    return bar;
  });
  const about = isLive
    ? el("h3", { title: "From the time an image was taken until its estimate was ready" }, "Latency")
    : el("h3", { title: "How long the estimate of a frame took" }, "Time per frame");
  return [about, el("div", { class: "histogram", role: "img", "aria-label": `Half of the frames took ${upTo(half)} ms` }, bars), el("p", { class: "axis" }, el("span", {}, `${limits[0]} ms`), el("span", {}, `half ${upTo(half)} ms`), el("span", {}, `${limits.at(-1)} ms`))];
}

/** The choices before a run of recordings; live cameras have no end, and do not wait. */
function endControl(app) {
  if (hasLive(app)) return null;
  const smooth = el("input", { type: "checkbox", id: "smooth", checked: isSmooth, onchange: () => (isSmooth = smooth.checked) });
  const page = el("input", { type: "checkbox", id: "page", checked: isPaged, onchange: () => (isPaged = page.checked) });
  return [
    el("label", { class: "check", title: "Each position then also takes account of what came after it: it is more accurate." }, smooth, "Smooth the track at the end"),
    el("label", { class: "check", title: "One file with pictures, 3D view and plots, which can be sent and opened in any browser." }, page, "Write a page of it, with pictures"),
  ];
}

/** Why places in the pictures were ruled out, each reason once; none while the picture says it all. */
function ruledOut(app, isMissing) {
  const topic = (name) => (isReplay && canReplay(app) ? name : `run/${name}`);
  const notes = app.state.cameras.flatMap(({ name }) => app.images.get(topic(name))?.about.notes ?? []);
  const reasons = new Map(notes.filter(({ why }) => why).map(({ text, why }) => [text, why]));
  if (!isMissing || reasons.size === 0) return null;
  return [el("p", { class: "none" }, "What was examined in this frame, and ruled out:"), el("ul", { class: "reasons", id: "reasons" }, [...reasons].map(([text, why]) => el("li", {}, el("code", {}, text), ` ${why}`)))];
}

const isMissing = ({ state }) => state === "searching" || state === "lost";

export const track = {
  id: "track",
  title: "Track",
  showsAll: true,
  isBegun: ({ state }) => state.targets.length > 0 && state.cameras.length > 0,
  isDone: ({ state }) => Boolean(state.run && !state.run.goes_on && !state.run.error),
  hint: ({ state: { run, watched } }) =>
    run?.goes_on || watched ? "The white line is the best fit, the dots are hypotheses." : run?.error ? "The run could not go on. What is missing is below." : run ? "The run has ended. Its report is below its last values." : "Everything set? Start, and see whether the outlines stay on the object.",
  picture: (app) => ({ draw: (context, px, about) => about.marks && drawMarks(context, px, about) }),
  imageOf: (app, name) => {
    const image = app.state.run && app.images.get(isReplay ? name : `run/${name}`);
    return image && { ...image, isOfRun: true };
  },
  // Rows that are smoothed replace those that the viewer has.
  pictureKey: (app) => [isViewer, canReplay(app), Boolean(app.state.run?.smoothed)],
  hidesPictures: () => isViewer,
  above: (app) => {
    const tab = (is, text, id) => button(text, () => { isViewer = is; app.render(); }, { id, "aria-pressed": String(isViewer === is), disabled: is && !app.state.run });
    return el("div", { class: "tabs" }, tab(false, "Pictures", "show-pictures"), tab(true, "3D and plots", "show-viewer"));
  },
  below: (app) => {
    closeViewer();
    if (!isViewer) return canReplay(app) ? replayBar(app, isReplay, () => (isReplay = true)) : null;
    const host = el("div", { id: "viewer" });
    // Once it is part of the page.
    setTimeout(openViewer, 0, app, host);
    return host;
  },
  leave: () => {
    closeViewer();
    // Another step may show other frames.
    isReplay = false;
  },
  seen: (app, topic) => isReplay && topic.startsWith("image/") && updateNow(app),
  told: (app, topic, value) => {
    if (topic === "track" || topic === "scene") {
      told_ms = performance.now();
      updateNow(app);
    }
    if (topic.startsWith("source/") && isReplay && canReplay(app)) updateReplay(app);
    if (topic !== "scene") return;
    // Another run.
    isReplay = false;
    other = comparison = null;
    if (viewer) {
      viewer.setComparison(null);
      viewer.setTracks({});
      viewer.setScene(value);
      next = 0;
    }
  },

  render(app) {
    const { run, watched } = app.state;
    const goes = run?.goes_on;
    if (goes) timer ??= setInterval(() => silentFor_s(app) >= SILENT_S && updateNow(app), 1000);
    chooseLast(app);
    return [
      !watched && el(
        "p",
        { class: "row" },
        goes
          ? button("Stop", () => app.change("stop"), { id: "stop", class: "primary" })
          : button(run ? "Track again" : "Track", () => start(app), { id: "start", class: "primary" }),
        !app.state.is_saved && button("Save the scene", () => app.change("save").then((answer) => answer && app.say("Saved.")), { id: "save-here" }),
      ),
      !watched && !goes && [recordControl(app), endControl(app)],
      !watched && run && !goes && [recordingControl(app), compareControl(app, other, comparison, (number) => compareWith(app, number)), settingsControl(app)],
      el("div", { id: "now" }, nowOf(app)),
      run?.error && el("p", { class: "bad", id: "run-error" }, run.error),
      run?.smoothed && el("p", { class: "none", id: "smoothed" }, "The track is smoothed; filtered.csv has it as it was while tracking."),
      run && !run.goes_on && !run.error && el("p", { class: "none", id: "results" }, "The results are in ", el("code", {}, run.folder), ": the track in tracks.csv, and plots."),
      run?.report && disclosure("report-of-run", "Report", el("pre", { id: "report" }, run.report), true),
    ];
  },
};

/** How long the run has given no values, in seconds; 0 if it has ended. */
const silentFor_s = (app) => (app.state.run?.goes_on ? Math.floor((performance.now() - told_ms) / 1000) : 0);

function nowOf(app) {
  const now = app.latest.get("track");
  const silent_s = silentFor_s(app);
  if (!app.state.run || app.state.run.error) return [];
  if (!now) return silent_s >= SILENT_S ? [el("p", { class: "bad", id: "silence" }, `No frame for ${silent_s} s.`)] : [];
  if (isReplay && canReplay(app)) {
    const about = replayedNow(app);
    if (!about?.targets) return [];
    // Of several cameras, the run has frames of its own.
    const frame = app.state.cameras.length > 1 ? `${about.targets[0]?.row ?? "–"} of the run` : about.index;
    return [el("p", { class: "time" }, `Frame ${frame}, ${instant(about.time_s)}, replayed`), about.targets.map(targetRow), ruledOut(app, about.targets.some(isMissing))].flat(9).filter(Boolean);
  }
  const age = now.age_s === null || silent_s >= SILENT_S || !app.state.run.goes_on ? "" : `, ${fixed(1e3 * now.age_s, 0)} ms old`;
  const targets = app.state.run.smoothed ?? now.targets;
  const recorded = app.state.run.goes_on && now.recording ? recordedText(now.recording) : [];
  const silence = silent_s >= SILENT_S && el("p", { class: "bad", id: "silence" }, `No new frame for ${silent_s} s: these values are old.`);
  const of = app.state.run.goes_on ? "" : "At the end: ";
  return [...recorded, silence, el("p", { class: "time" }, `${of}Frame ${now.frame}, ${instant(now.time_s)}${age}`), el("div", { class: silence ? "stale" : "" }, targets.map(targetRow)), ruledOut(app, targets.some(isMissing)), histogram(now.times_ms, now.age_s !== null)].flat(9).filter(Boolean);
}

function updateNow(app) {
  document.getElementById("now")?.replaceChildren(...nowOf(app).flat(9));
}
