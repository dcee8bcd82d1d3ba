// Step 2: how each camera maps the world to its image.

import { ask } from "../connection.js";
import { button, el, field, fixed } from "../elements.js";
import { boardTold, drawBoard, renderBoard } from "./board.js";

const WAYS = { simple: "Angle or file", board: "A board" };

let way = "simple";
let listing = null;
/** A calibration file of several cameras, and their names; null while none is to be chosen. */
let several = null;

async function list(app, folder = null) {
  try {
    listing = await ask("files", { folder });
    const { entries } = listing;
    if (folder === null && entries.length === 1 && entries[0].kind === "folder") return list(app, entries[0].path);
  } catch (error) {
    app.say(error.message, true);
  }
  app.render();
}

/** Draws the angle of view: the angles from the optical axis, in steps of ten degrees. */
function drawAngles(context, px, camera) {
  const size = camera?.source?.size_px;
  if (!size || !camera.fov_deg) return;
  const [u, v] = [0.5 * (size[0] - 1), 0.5 * (size[1] - 1)];
  const focal = (0.5 * Math.max(...size)) / Math.tan((0.5 * camera.fov_deg * Math.PI) / 180);
  context.strokeStyle = "#fffb";
  context.fillStyle = "#fff";
  context.lineWidth = 1.2 * px;
  context.font = `${12 * px}px system-ui, sans-serif`;
  for (let angle = 10; angle < 85; angle += 10) {
    const radius = focal * Math.tan((angle * Math.PI) / 180);
    if (radius > Math.hypot(...size)) break;
    context.beginPath();
    context.arc(u, v, radius, 0, 2 * Math.PI);
    context.stroke();
    if (radius < u) context.fillText(`${angle}°`, u + radius + 3 * px, v - 3 * px);
  }
}

/** By how many per cent distances shrink if an angle of view grows by one degree: the focal length is half the image over the tangent of half the angle. */
const percentOfDegree = (fov_deg) => (100 * Math.PI) / 180 / Math.sin((fov_deg * Math.PI) / 180);

export const camera = {
  id: "camera",
  title: "Camera",
  isBegun: ({ state }) => state.cameras.length > 0,
  isDone: ({ state }) => state.cameras.length > 0 && !state.guesses.some(({ step }) => step === "camera"),
  hint: (app) => {
    if (app.camera) return `How does the camera ${app.camera === "camera" ? "" : `${app.camera} `}see? A calibration is best; its angle of view will do for a start.`;
    const isUnread = app.state.problems.some(({ key }) => key.startsWith("cameras."));
    return isUnread ? "The scene has cameras that cannot be read. Mend in an editor what is named below, or remove them there and add them here." : "Add a camera first.";
  },
  picture: (app, name) => ({
    draw: (context, px) => (way === "board" ? drawBoard(app, context, px, name) : drawAngles(context, px, app.state.cameras.find((one) => one.name === name))),
  }),
  pictureKey: () => way,
  told: (app, topic, value) => topic === "board" && way === "board" && boardTold(app, value),
  /** Nobody sees what is found. */
  leave: (app) => app.latest.get("board")?.is_looking && ask("leave_board"),

  render(app) {
    const one = app.state.cameras.find(({ name }) => name === app.camera);
    if (!one) return [];
    if (!listing) list(app);
    const fov = el("input", { type: "number", id: "fov", min: 1, max: 170, step: "any", value: fixed(one.fov_deg ?? 60, 1), onchange: () => setFov() });
    const setFov = () => app.change("set_fov", { camera: one.name, fov_deg: Number(fov.value) }).then((answer) => answer || app.render());
    const files = (listing?.entries ?? []).filter(({ kind }) => kind === "folder" || kind === "text");
    const isGuess = app.state.guesses.some(({ key }) => key.startsWith(`cameras.${one.name}.model`));
    const now = one.calibration ? `Calibrated: ${one.calibration} (${one.model}).` : isGuess ? "A typical angle of view was guessed." : one.fov_deg ? `By its angle of view, ${fixed(one.fov_deg, 1)}°. With 1° more, all distances are ${fixed(percentOfDegree(one.fov_deg), 1)} % smaller.` : `${one.model}, as the scene says.`;
    const use = async (file, of = null) => {
      const answer = await app.change("set_calibration", { camera: one.name, file, of });
      several = answer?.choose ? { file, names: answer.choose, camera: one.name } : null;
      app.render();
    };
    const ways = Object.entries(WAYS).map(([id, name]) => button(name, () => { way = id; app.render(); }, { id: `way-${id}`, "aria-pressed": String(id === way) }));
    const head = [el("p", { class: "now" }, now), el("div", { class: "tabs" }, ways)];
    if (way === "board") return [head, renderBoard(app, one.name, listing, (folder) => list(app, folder))];
    return [
      head,
      el("h3", {}, "Angle of view"),
      el("p", {}, "The angle that the longer side of the image covers. Webcams have 50° to 75°, phones about 65°."),
      el(
        "form",
        { class: "row", onsubmit: (event) => { event.preventDefault(); setFov(); } },
        field("Degrees", fov),
        el("button", { type: "submit", id: "set-fov" }, "Set"),
      ),
      el("h3", {}, "Calibration file"),
      el("p", {}, "Of Pardalis, OpenCV, ROS, Kalibr, OCamCalib or Basalt."),
      listing?.folder && el("p", { class: "folder" }, listing.above !== null && button("↑", () => list(app, listing.above), { "aria-label": "Folder above" }), el("span", { title: listing.folder }, el("bdi", {}, listing.folder))),
      several?.camera === one.name && [
        el("p", { class: "now" }, `Which of the cameras in this file is ${one.name}?`),
        el("p", { class: "row" }, several.names.map((name) => button(name, () => use(several.file, name), { class: "of-file" }))),
      ],
      el("ul", { class: "files" }, files.map(({ name, path, kind }) => el("li", {}, button([el("span", { class: "symbol", "aria-hidden": "true" }, kind === "folder" ? "▸" : "·"), name], () => (kind === "folder" ? list(app, path) : use(path)), { class: "entry" })))),
    ];
  },
};
