// Step 3: where each camera is.

import { ask } from "../connection.js";
import { button, choice, el, field, fixed } from "../elements.js";
import { drawText } from "../picture.js";
import { drawBalls, renderWave, waveTold } from "./wave.js";

const WAYS = { points: "Known points", rectangle: "A rectangle on the floor", board: "A calibration board on the floor", ball: "A waved ball, for all cameras at once" };
const AXES = [["x", "#ff5a4f"], ["y", "#52d273"], ["z", "#5aa9ff"]];

let way = "points";
/** The known points of each camera: `{ at_px, world_m }`. They are no part of the scene: the tab keeps them, for when the page is loaded anew. */
const points = new Map();
/** Under which name. */
let kept = null;
/** The floor as each camera shows it, and of which state that is. */
const floors = new Map();
let size_m = [1, 1];
let board = "checkerboard:9x6:0.025";

const pointsOf = (name) => points.get(name) ?? points.set(name, []).get(name);

/** Returns the points of another camera, which are the same places as those of this one unless somebody says otherwise; an empty list if there are none. */
const othersOf = (name) => [...points].find(([other, list]) => other !== name && list.length > 0)?.[1] ?? [];

const keep = () => sessionStorage.setItem(kept, JSON.stringify([...points]));

function restore(app) {
  if (kept) return;
  kept = `points of ${app.state.path}`;
  for (const [name, list] of JSON.parse(sessionStorage.getItem(kept) ?? "[]")) {
    points.set(name, list);
    app.pictures.get(name)?.redraw();
  }
}

/** Adds a known point. With the last one whose place is known from another camera, the pose is. */
function mark(app, name, at_px) {
  const known = pointsOf(name);
  const others = othersOf(name);
  known.push({ at_px, world_m: [...(others[known.length]?.world_m ?? [0, 0, 0])] });
  redrawn(app);
  if (way === "points" && known.length >= 4 && known.length === others.length) compute(app, "set_pose", { points: known });
}

/** Asks for the floor as the camera shows it. */
async function look(app, { name, has_pose: hasPose }, isGuess) {
  if (!hasPose && !isGuess) return;
  const key = app.state.text;
  if (floors.get(name)?.key === key) return;
  floors.set(name, { key });
  try {
    floors.set(name, { key, ...(await ask("grid", { camera: name })) });
  } catch {
    // The problems of the steps before say why.
  }
  app.pictures.get(name)?.redraw();
  app.render();
}

function drawLine(context, line) {
  context.beginPath();
  let last = null;
  for (const point of line) {
    // What is near the camera's plane is far outside of the image.
    const isFar = point && Math.hypot(...point) > 1e5;
    if (point && !isFar && last) context.lineTo(...point);
    else if (point && !isFar) context.moveTo(...point);
    last = isFar ? null : point;
  }
  context.stroke();
}

function draw(context, px, name, about) {
  if (way === "ball") return drawBalls(context, px, about);
  const floor = floors.get(name);
  for (const [color, width] of [["#0007", 2.6], ["#fffa", 1.1]]) {
    context.strokeStyle = color;
    context.lineWidth = width * px;
    for (const line of floor?.lines ?? []) drawLine(context, line);
  }
  floor?.axes?.forEach((line, i) => {
    const [axis, color] = AXES[i];
    context.strokeStyle = color;
    context.lineWidth = 4 * px;
    drawLine(context, line);
    if (line.at(-1)) drawText(context, px, axis, line.at(-1), color);
  });
  pointsOf(name).forEach(({ at_px: [u, v] }, i) => {
    context.strokeStyle = "#000";
    context.fillStyle = "#ffd21f";
    context.lineWidth = 1.5 * px;
    context.beginPath();
    context.arc(u, v, 5 * px, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    drawText(context, px, String(i + 1), [u + 9 * px, v + 4 * px], "#ffd21f");
  });
}

async function compute(app, request, value) {
  const answer = await app.change(request, { camera: app.camera, ...value });
  if (!answer) return;
  const left = answer.outliers?.length ? `, without point ${answer.outliers.map((i) => i + 1).join(", ")}` : "";
  const advice = answer.note ? `, but ${answer.note}.` : ". Does the grid lie on the floor?";
  app.say(`The pose fits to ${fixed(answer.rms_px, 1)} pixels${left}${advice}`, Boolean(answer.note));
}

function redrawn(app) {
  keep();
  app.pictures.get(app.camera)?.redraw();
  app.render();
}

function list(app) {
  const known = pointsOf(app.camera);
  const rows = known.map((point, number) =>
    el(
      "li",
      {},
      el("strong", {}, String(number + 1)),
      ["x", "y", "z"].map((axis, i) =>
        el("input", {
          type: "number", step: "any", id: `point-${number}-${axis}`, value: point.world_m[i], "aria-label": `${axis} of point ${number + 1} in metres`,
          onchange: (event) => { point.world_m[i] = Number(event.target.value); keep(); },
        }),
      ),
      button("×", () => { known.splice(number, 1); redrawn(app); }, { "aria-label": `Remove point ${number + 1}` }),
    ),
  );
  return [
    rows.length > 0 && el("p", { class: "axes" }, "x, y, z in metres; z is up"),
    el("ul", { class: "points" }, rows),
    el("p", {}, button("Compute the pose", () => compute(app, "set_pose", { points: known }), { id: "compute", class: "primary", disabled: known.length < 4 }), known.length < 4 && ` ${known.length} of at least 4 points`),
  ];
}

async function find(app) {
  const found = await app.change("find_rectangle", { camera: app.camera });
  if (!found) return;
  points.set(app.camera, found.corners_px.map((at_px) => ({ at_px, world_m: [0, 0, 0] })));
  measure(app);
}

/** Gives the four corners of the rectangle their places. */
function measure(app) {
  const [width, depth] = size_m;
  const corners = [[0, 0, 0], [width, 0, 0], [width, depth, 0], [0, depth, 0]];
  const known = pointsOf(app.camera);
  if (known.length === 4) known.forEach((point, i) => { point.world_m = corners[i]; });
  redrawn(app);
}

const WAYS_TO = {
  points: (app) => [
    el("p", {}, "Click at least four places in the picture that you have measured: corners of tiles or of a table. Type where they are in the room."),
    othersOf(app.camera).length > 0 && el("p", { class: "none", id: "same-places" }, "Click the same places in the same order as in the other camera: they have its numbers already."),
    list(app),
  ],
  rectangle: (app) => {
    const sizes = ["along 1 → 2", "along 2 → 3"].map((name, i) =>
      field(`Metres ${name}`, el("input", { type: "number", min: 0, step: "any", id: `size-${i}`, value: size_m[i], onchange: (event) => { size_m[i] = Number(event.target.value); measure(app); } })),
    );
    const turn = () => { const known = pointsOf(app.camera); known.push(known.shift()); measure(app); };
    return [
      el("p", {}, "Tape or a sheet on the floor that stands out. Corner 1 is the origin of the room."),
      el("p", { class: "row" }, sizes),
      el("p", { class: "row" }, button("Find it", () => find(app), { id: "find" }), button("Begin at the next corner", turn, { disabled: pointsOf(app.camera).length !== 4 })),
      list(app),
    ];
  },
  board: (app) => {
    const input = el("input", { type: "text", id: "board", value: board, spellcheck: "false", onchange: (event) => { board = event.target.value.trim(); } });
    return [
      el("p", {}, "Lay the board on the floor, face up, in full view. Its first corner is the origin of the room."),
      field("Board", input, "checkerboard:COLUMNSxROWS:SQUARE, with inner corners and metres; or charuco:…, aprilgrid:…"),
      el("p", {}, button("Find it and compute the pose", () => compute(app, "set_pose_of_board", { board: input.value.trim() }), { id: "find-board", class: "primary" })),
    ];
  },
  ball: (app) => renderWave(app, points),
};

export const pose = {
  id: "pose",
  title: "Pose",
  isBegun: ({ state }) => state.cameras.length > 0,
  isDone: ({ state }) => state.cameras.length > 0 && !state.guesses.some(({ step }) => step === "pose"),
  /** The ball is looked for in all cameras. */
  get showsAll() { return way === "ball"; },
  told: (app, topic, value) => topic === "rig" && way === "ball" && waveTold(app, value),
  hint: (app) => (way === "ball" ? "Where are the cameras? One waved ball tells it, and by how much their clocks differ." : app.camera ? `Where is ${app.camera}, and where does it look? The grid shows where the scene has the floor.` : "Add a camera first."),
  picture: (app, name) => ({
    help: "Arrows move a cross, Enter marks a known point.",
    point: (way === "points" || way === "rectangle") && ((at_px) => mark(app, name, at_px)),
    draw: (context, px, about) => draw(context, px, name, about),
  }),
  pictureKey: () => way,

  render(app) {
    restore(app);
    const one = app.state.cameras.find(({ name }) => name === app.camera);
    if (!one) return [];
    const isGuess = app.state.guesses.some(({ key }) => key === `cameras.${one.name}.world_from_camera`);
    if (way !== "ball") look(app, one, isGuess);
    const at = one.position_m && one.position_m.map((value) => fixed(value, 2)).join(", ");
    const step = floors.get(one.name)?.step_m;
    const ways = Object.entries(WAYS).filter(([id]) => id !== "ball" || app.state.cameras.length > 1);
    const guess = app.state.cameras.length > 1
      ? "A guess: the first camera is level, and a metre above the floor. After a waved ball, distances are right nevertheless; directions and heights in the room are not."
      : "A guess. With one camera you can go on: distances from the camera do not depend on it, directions in the room do.";
    const now = isGuess ? guess : one.has_pose ? `At ${at} m.` : "Not known yet.";
    return [
      way !== "ball" && el("p", { class: "now" }, now, step && ` The lines of the grid are ${step} m apart.`),
      field("From", choice(ways, way, (value) => { way = value; app.render(); }, { id: "way" })),
      WAYS_TO[way](app),
    ];
  },
};
