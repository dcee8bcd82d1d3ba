// Step 6: the run.

import { button, el, fixed } from "../elements.js";
import { drawMarks } from "../picture.js";

const COLORS = { tracking: "good", occluded: "fair", lost: "bad", searching: "fair" };

function targetRow({ name, state, confidence, position_m: at, sigma_m: sigma }) {
  const meter = el("meter", { min: 0, max: 1, low: 0.3, high: 0.7, optimum: 1, value: confidence, "aria-label": "Confidence" });
  const axes = ["x", "y", "z"].map((axis, i) => el("tr", {}, el("th", { scope: "row" }, axis), el("td", {}, fixed(at?.[i], 3)), el("td", {}, sigma ? `± ${fixed(1000 * sigma[i], 0)} mm` : "")));
  return el(
    "section",
    { class: "target", "data-target": name },
    el("h3", {}, name, " ", el("span", { class: `state ${COLORS[state] ?? ""}` }, state)),
    el("p", { class: "confidence" }, meter, ` ${Math.round(100 * confidence)} % certain`),
    el("table", {}, axes),
  );
}

function histogram({ limits, counts }) {
  const most = Math.max(...counts, 1);
  const total = counts.reduce((sum, count) => sum + count, 0);
  let [sum, half] = [0, 0];
  counts.forEach((count, i) => {
    if (sum < total / 2) half = limits[i] ?? limits.at(-1);
    sum += count;
  });
  const bars = counts.map((count, i) => {
    const bar = el("span", { title: `${limits[i] === undefined ? `above ${limits.at(-1)}` : `up to ${limits[i]}`} ms: ${count}` });
    bar.style.height = `${(100 * count) / most}%`;
    return bar;
  });
  return [el("h3", {}, "Time per frame"), el("div", { class: "histogram", role: "img", "aria-label": `Half of the frames took up to ${half} ms` }, bars), el("p", { class: "axis" }, el("span", {}, `${limits[0]} ms`), el("span", {}, `half up to ${half} ms`), el("span", {}, `${limits.at(-1)} ms`))];
}

export const track = {
  id: "track",
  title: "Track",
  showsAll: true,
  isBegun: ({ state }) => state.targets.length > 0 && state.cameras.length > 0,
  isDone: ({ state }) => Boolean(state.run && !state.run.goes_on && !state.run.error),
  hint: ({ state }) => (state.run?.goes_on ? "The white line is the best fit, the dots are hypotheses." : "Everything set? Start, and see whether the outlines stay on the object."),
  picture: (app) => ({ draw: (context, px, about) => about.marks && drawMarks(context, px, about) }),
  told: (app, topic) => topic === "track" && updateNow(app),

  render(app) {
    const { run } = app.state;
    const goes = run?.goes_on;
    return [
      el(
        "p",
        { class: "row" },
        goes
          ? button("Stop", () => app.change("stop"), { id: "stop", class: "primary" })
          : button(run ? "Track again" : "Track", () => app.change("track"), { id: "start", class: "primary" }),
        !app.state.is_saved && button("Save the scene", () => app.change("save").then((answer) => answer && app.say("Saved.")), { id: "save-here" }),
      ),
      el("div", { id: "now" }, nowOf(app)),
      run?.error && el("p", { class: "bad", id: "run-error" }, run.error),
      run?.report && el("details", { open: true }, el("summary", {}, "Report"), el("pre", { id: "report" }, run.report)),
    ];
  },
};

function nowOf(app) {
  const now = app.latest.get("track");
  if (!app.state.run || !now) return [];
  return [el("p", { class: "time" }, `Frame ${now.frame + 1}, ${fixed(now.time_s, 2)} s`), now.targets.map(targetRow), histogram(now.tracking_ms)].flat();
}

function updateNow(app) {
  document.getElementById("now")?.replaceChildren(...nowOf(app).flat(9));
}
