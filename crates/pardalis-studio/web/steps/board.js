// A board that is held up to a camera: what it shows so far, the calibration and its report.

import { button, choice, disclosure, el, field, fixed, replaceChildren } from "../elements.js";

const KINDS = { checkerboard: "Checkerboard", charuco: "ChArUco board", aprilgrid: "AprilGrid" };
const UNITS = { mm: 1e-3, cm: 1e-2, m: 1 };
const MODELS = {
  all: "The best of all",
  pinhole: "Pinhole: ordinary lens",
  kannala_brandt: "Kannala-Brandt: fisheye",
  double_sphere: "Double sphere: fisheye",
  extended_unified: "Extended unified: fisheye",
  equidistant: "Equidistant: fisheye",
  ocam: "Polynomial: fisheye or mirror",
  mei: "Mei: fisheye or mirror",
  unified: "Unified: mirror",
};
/** What must be filled in for each kind, with a value to begin with. Lengths are in the unit that is chosen. */
const FIELDS = {
  checkerboard: [["columns", "Inner corners across", 9], ["rows", "Inner corners down", 6], ["side", "Square", 25]],
  charuco: [["columns", "Squares across", 5], ["rows", "Squares down", 7], ["side", "Square", 40], ["marker", "Marker", 30], ["dictionary", "Dictionary", "DICT_4X4_50"]],
  aprilgrid: [["columns", "Tags across", 6], ["rows", "Tags down", 6], ["side", "Tag", 88], ["gap", "Gap, in tags", 0.3]],
};

let kind = "checkerboard";
let unit = "mm";
let model = "all";
/** What has been typed, by kind and name. */
const typed = new Map();

const valueOf = (name, first) => typed.get(`${kind}.${name}`) ?? first;

/** Returns the board as on the command line. */
function words() {
  const value = Object.fromEntries(FIELDS[kind].map(([name, , first]) => [name, valueOf(name, first)]));
  // Without digits of rounding.
  const metres = (length) => Number((Number(length) * UNITS[unit]).toPrecision(9));
  const size = `${value.columns}x${value.rows}:${metres(value.side)}`;
  if (kind === "charuco") return `charuco:${size}:${metres(value.marker)}:${value.dictionary}`;
  return kind === "aprilgrid" ? `aprilgrid:${size}:${value.gap}` : `checkerboard:${size}`;
}

/** Returns what was seen of the board of a camera; null before the first time. */
function seenBy(app, camera) {
  const board = app.latest.get("board");
  return board?.camera === camera ? board : null;
}

/** Draws which parts of the image are covered, and the corners that were found last. */
export function drawBoard(app, context, px, camera) {
  const board = seenBy(app, camera);
  const size = app.state.cameras.find(({ name }) => name === camera)?.source?.size_px;
  if (!board || !size) return;
  const [width, height] = size.map((side) => side / 10);
  context.fillStyle = "#2dd4bf2e";
  board.cells.forEach((row, j) => row.forEach((is, i) => is && context.fillRect(i * width - 0.5, j * height - 0.5, width, height)));
  if (!board.is_looking || !board.newest || board.is_of_folder) return;
  const color = board.newest.reason ? "#ffd21f" : "#2dd4bf";
  const corners = board.newest.corners_px;
  for (const [stroke, wide] of [["#000a", 3], [color, 1.5]]) {
    context.strokeStyle = stroke;
    context.lineWidth = wide * px;
    for (const [u, v] of corners) {
      context.beginPath();
      context.arc(u, v, 5 * px, 0, 2 * Math.PI);
      context.stroke();
    }
  }
}

/** What of the board changes rarely, and with it the whole panel. */
const rareOf = ({ is_looking: isLooking, is_fitting: isFitting, names, fitted, error } = {}) => JSON.stringify([isLooking, isFitting, names?.length, fitted, error]);
let rare = null;

/** Shows what is new of the board. */
export function boardTold(app, board) {
  app.pictures.get(board?.camera)?.redraw();
  if (rareOf(board ?? {}) !== rare) {
    rare = rareOf(board ?? {});
    app.render();
  } else if (document.getElementById("board-now")) {
    showNow(document.getElementById("board-now"), board);
  }
}

/** Shows what is new, and leaves the list of what was left out in its place: it could not be clicked or focused if it came anew with each picture. */
function showNow(place, board) {
  const [advice, seen, count, leftOut] = nowOf(board);
  const list = leftOut && document.getElementById("board-left-out");
  if (!list) {
    replaceChildren(place, [advice, seen, count, leftOut]);
    return;
  }
  list.querySelector("ul").replaceChildren(...leftOut.querySelector("ul").children);
  [...place.children].filter((child) => child !== list).forEach((child) => child.remove());
  place.prepend(...[advice, seen, count].filter(Boolean));
}

function nowOf(board) {
  const { advice, fitted, newest, names, share, tilted, left_out: leftOut } = board;
  const name = board.is_of_folder && newest ? `${newest.name}: ` : "";
  const seen = name + (newest?.reason ?? (newest ? "taken" : "waiting for a picture"));
  return [
    el("p", { class: "now", id: "board-advice" }, advice ?? (fitted ? "Calibrated: use it, or show more views." : "These views are enough: calibrate.")),
    board.is_looking && el("p", { class: "none", id: "board-seen" }, `Now: ${seen}.`),
    el("p", { id: "board-count" }, el("strong", {}, `${names.length} view${names.length === 1 ? "" : "s"}`), ` · ${fixed(100 * share, 0)} % of the image · ${tilted} tilted`),
    leftOut.length > 0 && disclosure("board-left-out", "Left out", el("ul", {}, leftOut.map(({ reason, count, last }) => el("li", {}, `${count} × ${reason} (last in ${last})`)))),
  ];
}

function report(app, board) {
  const isUsed = app.state.cameras.find(({ name }) => name === board.camera)?.calibration?.endsWith(".lens.toml");
  const { model: name, rms_px: rms, held_out_rms_px: heldOut, notes, warnings, report: text } = board.fitted;
  return [
    el("h3", {}, "Calibration"),
    el("p", { id: "board-rms" }, el("strong", {}, name), `: points fit to ${fixed(rms, 2)} pixels`, heldOut !== null && `, points that were held out to ${fixed(heldOut, 2)}`, "."),
    notes.map((note) => el("p", { class: "none" }, note)),
    warnings.length > 0 && el("ul", { class: "problems" }, warnings.map((warning) => el("li", { class: "warning" }, warning))),
    disclosure("report-of-board", "Report", el("pre", { id: "board-report" }, text)),
    button("Use it", async () => (await app.change("use_board")) && app.say("The lens is in the scene."), { id: "use-board", class: isUsed ? "" : "primary" }),
  ];
}

/** The folders of pictures to choose from. `open` goes into one, or above. */
function folders(app, camera, { folder, above, entries }, open) {
  const use = (path) => app.change("look_for_board_in", { camera, board: words(), folder: path });
  const inside = entries.filter(({ kind }) => kind === "folder");
  const hasPictures = entries.some(({ kind }) => kind === "image");
  return disclosure("board-folder", "Pictures of it in a folder", [
    el("p", {}, "Taken with this camera and its present settings. Each picture in which the board is found is used."),
    folder && el("p", { class: "folder" }, above !== null && button("↑", () => open(above), { "aria-label": "Folder above" }), hasPictures && button("Use this folder", () => use(folder), { id: "use-folder" }), el("span", { title: folder }, folder)),
    el("ul", { class: "files" }, inside.map(({ name, path }) => el("li", {}, button([el("span", { class: "symbol", "aria-hidden": "true" }, "▸"), name], () => open(path), { class: "entry", title: `Open ${name}` }), button("Use", () => use(path), { "aria-label": `Use the pictures in ${name}` })))),
  ]);
}

/** Returns the controls of a camera's board. `listing` is a folder with its entries, and `open` goes to another. */
export function renderBoard(app, camera, listing, open) {
  const board = seenBy(app, camera);
  const isLooking = board?.is_looking;
  const inputs = FIELDS[kind].map(([name, title, first]) =>
    field(title, el("input", { type: name === "dictionary" ? "text" : "number", min: 0, step: "any", id: `board-${name}`, value: valueOf(name, first), onchange: (event) => typed.set(`${kind}.${name}`, event.target.value.trim()) })),
  );
  const again = (value) => { [kind, unit] = value; app.render(); };
  const start = async () => {
    if (!(await app.change("look_for_board", { camera, board: words() }))) return;
    await app.order(camera, { is_playing: true });
  };
  return [
    !board && el("p", {}, "Hold a printed board up to the camera, still, at many places of the image, near and far, and tilted."),
    !isLooking && [
      el("div", { class: "row" }, field("Board", choice(Object.entries(KINDS), kind, (value) => again([value, unit]), { id: "board-kind" })), field("Lengths in", choice(Object.keys(UNITS).map((name) => [name, name]), unit, (value) => again([kind, value]), { id: "board-unit" }))),
      el("div", { class: "row wraps" }, inputs),
      el("p", { class: "none" }, "pardalis calibrate print draws one. Measure a square: printers stretch."),
    ],
    el(
      "p",
      { class: "row" },
      isLooking
        ? button("Pause", () => app.change("leave_board"), { id: "leave-board" })
        : button(board?.names.length && !board.is_of_folder ? "Go on" : "Look for it", start, { id: "look", class: board?.names.length ? "" : "primary" }),
      board && button("Begin again", () => app.change("forget_board"), { id: "forget-board" }),
    ),
    !isLooking && listing && folders(app, camera, listing, open),
    board?.error && el("p", { class: "bad" }, board.error),
    board && el("div", { id: "board-now", "aria-live": "polite" }, nowOf(board)),
    board?.fitted && report(app, board),
    board?.can_fit && [
      field("Model", choice(Object.entries(MODELS), model, (value) => { model = value; }, { id: "board-model" })),
      el("p", {}, button(board.is_fitting ? "Calibrating …" : "Calibrate", () => app.change("fit_board", { model }), { id: "fit-board", class: board.is_enough && !board.fitted ? "primary" : "", disabled: board.is_fitting })),
    ],
  ];
}
