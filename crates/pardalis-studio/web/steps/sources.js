// Step 1: where the images come from.

import { ask } from "../connection.js";
import { button, el, field } from "../elements.js";
import { setNumber } from "./compare.js";

/** The folder that is listed, and the cameras of the computer; null before they are asked for. */
let listing = null;
let devices = null;

async function list(app, folder = null) {
  try {
    listing = await ask("files", { folder });
    // A single folder needs no choice.
    const { entries } = listing;
    if (folder === null && entries.length === 1 && entries[0].kind === "folder") return list(app, entries[0].path);
    devices ??= await ask("devices");
  } catch (error) {
    app.say(error.message, true);
  }
  app.render();
}

async function add(app, input, fps = null) {
  const answer = await app.change("add_source", { input, fps });
  if (!answer) return;
  // An address that was refused stays to be corrected.
  document.getElementById("address").value = "";
  app.select("camera", answer.cameras.at(-1).name);
}

const SYMBOLS = { folder: "▸", video: "▶", image: "▣", recording: "●" };

function entryOf(app, { name, path, kind }) {
  const isFolder = kind === "folder";
  return el(
    "li",
    {},
    button([el("span", { class: "symbol", "aria-hidden": "true" }, SYMBOLS[kind] ?? "·"), name], () => (isFolder ? list(app, path) : add(app, path)), {
      class: "entry", title: isFolder ? `Open ${name}` : `Add ${name}`,
    }),
    isFolder && button("Add", () => add(app, path), { "aria-label": `Add the images in ${name}` }),
  );
}

/** What is in the scene, with a field for its name. */
function addedOf(app, { name, input }) {
  const rename = () => {
    const wanted = field.value.trim().replace(/\s+/g, "-");
    if (wanted === name) return;
    app.change("rename_camera", { camera: name, name: wanted }).then((answer) => {
      if (answer) return app.select("camera", wanted);
      const again = document.getElementById(field.id);
      if (again) again.value = name;
    });
  };
  const field = el("input", { type: "text", class: "name-of", id: `name-${name}`, value: name, spellcheck: "false", "aria-label": `Name of ${name}`, title: "Type another name", onchange: rename });
  return el("li", {}, field, el("span", { class: "name", title: input }, input), button("Remove", () => app.change("remove", { kind: "cameras", name }), { "aria-label": `Remove ${name}` }));
}

/** The field for the rate of a folder of images, which carry no times. */
function rateOf(app, { name, fps }) {
  const input = el("input", { type: "number", id: `fps-${name}`, min: 0, step: "any", value: fps, onchange: () => setNumber(app, `cameras.${name}.fps`, Number(input.value)) });
  const isGuess = isGuessed(app, `cameras.${name}.fps`);
  const accept = isGuess && button("It is right", () => setNumber(app, `cameras.${name}.fps`, fps), { id: `accept-fps-${name}` });
  return el("p", { class: "row" }, field(`${name}: images per second`, input, isGuess && "This is a guess. Speeds are wrong by as many per cent as it is."), accept);
}

const isGuessed = (app, key) => app.state.guesses.some((guess) => guess.key === key);

export const sources = {
  id: "sources",
  title: "Sources",
  showsAll: true,
  isBegun: ({ state }) => state.cameras.length > 0,
  isDone: ({ state }) => state.cameras.length > 0 && !state.guesses.some(({ step }) => step === "sources"),
  hint: ({ state }) =>
    state.cameras.length === 0
      ? "Choose what shows the object: a camera, a video, or a folder of images."
      : "Check the pictures. Add further cameras that see the same place, or go on.",
  enter: (app) => {
    if (!listing) list(app);
  },

  render(app) {
    if (!listing) list(app);
    const address = el("input", { type: "text", id: "address", placeholder: "rtsp://…, http://… or /dev/video0", spellcheck: "false" });
    const added = app.state.cameras.map((camera) => addedOf(app, camera));
    const rates = app.state.cameras.filter(({ fps }) => fps !== null).map((camera) => rateOf(app, camera));
    const found = (devices ?? []).map(({ input, name }) => el("li", {}, el("span", { class: "name" }, el("strong", {}, name), " ", input), button("Add", () => add(app, input), { "aria-label": `Add ${name}` })));
    const entries = (listing?.entries ?? []).filter(({ kind }) => ["folder", "video", "image", "recording"].includes(kind));
    const folder = listing?.folder;
    return [
      added.length > 0 && [el("h3", {}, "In the scene"), el("ul", { class: "rows" }, added), rates],
      el("h3", {}, "Cameras of this computer"),
      found.length > 0 ? el("ul", { class: "rows" }, found) : el("p", { class: "none" }, "None was found. Network cameras are added by their address."),
      el(
        "form",
        { class: "row", onsubmit: (event) => { event.preventDefault(); const input = address.value.trim(); if (input) add(app, input); else address.focus(); } },
        field("Address of a camera or stream", address),
        el("button", { type: "submit" }, "Add"),
      ),
      el("h3", {}, "Recordings"),
      folder && el("p", { class: "folder" }, listing.above !== null && button("↑", () => list(app, listing.above), { "aria-label": "Folder above" }), button(`Add this folder`, () => add(app, folder), { id: "add-folder" }), el("span", { title: folder }, el("bdi", {}, folder))),
      el("ul", { class: "files" }, entries.map((entry) => entryOf(app, entry))),
      listing?.left_out > 0 && el("p", { class: "none" }, `and ${listing.left_out} more`),
    ];
  },
};
