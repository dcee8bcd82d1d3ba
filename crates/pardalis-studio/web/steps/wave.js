// A ball that is waved before all cameras: progress, what came of it, and its use.

import { button, choice, disclosure, el, field, fixed } from "../elements.js";

const WORLDS = { scene: "Nothing: the first camera's frame", points: "The known points", board: "A board that lies on the floor" };

let world = null;
let board = "checkerboard:9x6:0.025";
let seconds = 30;
/** Whether focal lengths are refined; by default if they are guesses. */
let isRefined = null;

/** Draws where the ball was found in the picture. */
export function drawBalls(context, px, { balls = [] } = {}) {
  for (const [color, width] of [["#000a", 4], ["#2dd4bf", 2]]) {
    context.strokeStyle = color;
    context.lineWidth = width * px;
    for (const { at_px: at, radius_px: radius } of balls) {
      context.beginPath();
      context.arc(...at, Math.max(radius, 3 * px), 0, 2 * Math.PI);
      context.stroke();
    }
  }
}

/** Shows what is new. */
export function waveTold(app) {
  app.render();
}

function progress({ cameras, elapsed_s: elapsed, duration_s: duration }) {
  return [
    duration !== null && el("p", { class: "now", id: "wave-time" }, `Wave the ball: ${fixed(Math.max(duration - elapsed, 0), 0)} s left.`),
    el(
      "table",
      { class: "figures", id: "wave-progress" },
      el("tr", {}, ["camera", "frames", "with the ball"].map((text) => el("th", {}, text))),
      cameras.map(({ name, frames, frame_count: count, found }) => el("tr", {}, el("td", {}, name), el("td", {}, count ? `${frames} / ${count}` : frames), el("td", {}, found))),
    ),
  ];
}

function report(app, { rows, notes, warnings }) {
  // One block for each camera: the panel is narrow.
  const [head, ...cameras] = rows;
  return [
    el("h3", {}, "Calibration"),
    cameras.map(([name, ...cells]) =>
      disclosure(
        `rig-${name}`,
        [el("strong", {}, name), ` fits to ${cells[head.indexOf("RMS (px)") - 1]} px, seen in ${cells[head.indexOf("detected in") - 1]} frames`],
        el("table", { class: "figures" }, cells.map((cell, i) => el("tr", {}, el("td", {}, head[i + 1]), el("td", {}, cell)))),
      ),
    ),
    warnings.length > 0 && el("ul", { class: "problems" }, warnings.map((warning) => el("li", { class: "warning" }, warning))),
    disclosure("rig-notes", "What the figures mean", notes.map((note) => el("p", { class: "none" }, note))),
    button("Use it", () => use(app), { id: "use-rig", class: "primary", disabled: !app.state.can_use_rig }),
  ];
}

async function use(app) {
  if (!(await app.change("use_rig"))) return;
  const isGuessed = app.state.guesses.some(({ step }) => step === "pose");
  app.say(`The poses are in the scene.${isGuessed ? " Where the room is remains a guess." : ""}`);
}

/** Returns the radius of a ball in metres; null if it is unknown or missing. */
const radiusOf = ({ shape }) => (typeof shape.sphere.radius_m === "number" ? shape.sphere.radius_m : null);

/** Returns what must be done in another step first; null if nothing. */
function missing(app, ball) {
  const to = (step, text) => el("p", {}, button(text, () => { location.hash = step; }, { id: "go-first", class: "primary" }));
  if (!ball?.has_colors) return [el("p", { class: "now" }, "The ball's colours come first: click it in a few pictures."), to("colors", "Learn its colours")];
  if (radiusOf(ball) === null) return [el("p", { class: "now" }, "The ball's diameter comes first: all lengths follow from it."), to("targets", "Set its diameter")];
  return null;
}

/** Returns the controls. `points` has the known points of each camera. */
export function renderWave(app, points) {
  const rig = app.latest.get("rig");
  const ball = app.state.targets.find(({ name, shape }) => name === app.target && shape?.sphere) ?? app.state.targets.find(({ shape }) => shape?.sphere);
  const first = missing(app, ball);
  if (first) return first;
  const known = [...points].filter(([name, list]) => list.length > 0 && app.state.cameras.some((one) => one.name === name));
  const count = known.reduce((sum, [, list]) => sum + list.length, 0);
  const isLive = app.state.cameras.some(({ source }) => source?.is_live);
  const isGuessed = app.state.guesses.some(({ step }) => step === "camera");
  const isPosed = app.state.cameras.some(({ has_pose: hasPose }) => hasPose);
  const isGuessedPose = app.state.guesses.some(({ step }) => step === "pose");
  const ofScene = isPosed ? "The first camera that has a pose" : isGuessedPose ? "Nothing: the first camera is taken to be level" : WORLDS.scene;
  const nameOf = (id) => (id === "points" ? `${WORLDS.points} (${count})` : id === "scene" ? ofScene : WORLDS[id]);
  const where = world ?? (count > 0 ? "points" : "scene");
  if (rig?.goes_on) {
    const stop = (isCancelled) => app.change("stop_waving", { is_cancelled: isCancelled });
    return [
      progress(rig),
      el("p", { class: "row" }, rig.duration_s !== null && button("Enough", () => stop(false), { id: "wave-enough", class: "primary" }), button("Cancel", () => stop(true), { id: "wave-cancel" })),
    ];
  }
  const start = () =>
    app.change("wave", {
      target: ball.name,
      duration_s: seconds,
      points: where === "points" ? known.map(([camera, list]) => ({ camera, points: list })) : [],
      board: where === "board" ? board : null,
      refine_focal: isRefined ?? isGuessed,
    });
  const diameter = app.state.guesses.some(({ key }) => key.startsWith(`targets.${ball.name}.shape`)) ? ", which is a guess: set it in the step Targets" : "";
  return [
    rig?.error && el("p", { class: "bad", id: "wave-error" }, rig.error),
    rig?.report && report(app, rig.report),
    el("p", {}, `Wave ${ball.name} to and fro, near and far, up and down, where two cameras or more see it, without a pause. Its diameter gives the scale: ${fixed(200 * radiusOf(ball), 1)} cm${diameter}.`),
    field("What says where the room is", choice(Object.keys(WORLDS).map((id) => [id, nameOf(id)]), where, (value) => { world = value; app.render(); }, { id: "wave-world" })),
    where === "points" && count < 4 && el("p", { class: "none" }, "Click at least four under Known points, in one camera or in several."),
    where === "board" && field("Board", el("input", { type: "text", id: "wave-board", value: board, spellcheck: "false", onchange: (event) => { board = event.target.value.trim(); } }), "At rest in view of a camera at the beginning."),
    isLive && field("Seconds", el("input", { type: "number", id: "wave-seconds", min: 5, max: 3600, value: seconds, onchange: (event) => { seconds = Number(event.target.value); } })),
    el("label", { class: "check" }, el("input", { type: "checkbox", id: "wave-refine", checked: isRefined ?? isGuessed, onchange: (event) => { isRefined = event.target.checked; } }), "Refine the focal lengths"),
    el("p", {}, button(isLive ? "Begin to wave" : "Find the poses", start, { id: "wave", class: rig?.report ? "" : "primary", disabled: where === "points" && count < 4 })),
  ];
}
