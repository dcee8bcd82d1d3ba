// Step 4: what each target looks like.

import { ask } from "../connection.js";
import { button, choice, disclosure, el, selectAtFirst } from "../elements.js";
import { drawOutline, drawText } from "../picture.js";

/** The share of the background that is usually taken for an object at most. Hand-set. */
const MOST_MISTAKEN = 0.2;

let isMarked = false;
let asked = null;

/** Reports whether the outline at a click can be fitted. */
const isBall = ({ shape }) => !shape || "sphere" in shape;

/** Asks for what has the colours of the target in the frame that is shown. */
async function mark(app) {
  const target = app.state.targets.find(({ name }) => name === app.target);
  if (!isMarked || !target?.samples.length || !app.camera) return;
  const key = JSON.stringify([app.camera, target, app.images.get(app.camera)?.about.index]);
  if (key === asked) return;
  asked = key;
  try {
    await ask("marked", { camera: app.camera, target: target.name });
  } catch (error) {
    asked = null;
    app.say(error.message, true);
  }
}

/** What the labels of a target show that is not as with an object of its own colours. */
function doubtsAbout({ samples, learnt }) {
  if (!learnt) return [];
  const named = learnt.failed.map((number) => samples[number]).filter(Boolean);
  const frames = named.map(({ camera, frame }) => `${camera} ${frame}`).join(", ");
  return [
    named.length > 0 && `It is not found again in the labelled frame ${frames}: is the outline on the object, and all of it? If not, remove the label and drag a box around it.`,
    learnt.mistaken > MOST_MISTAKEN && `${(100 * learnt.mistaken).toFixed(0)} % of the rest of the pictures has these colours, too: is the outline on the object?`,
  ].filter(Boolean);
}

function label(app, what) {
  app.change("label", { camera: app.camera, target: app.target, ...what }).then((answer) => answer && mark(app));
}

function addTarget(app, name) {
  app.change("add_target", { name }).then((answer) => answer && app.select("target", name));
}

export const colors = {
  id: "colors",
  title: "Colours",
  isBegun: ({ state }) => state.targets.some(({ samples }) => samples.length > 0),
  isDoubtful: ({ state }) => state.targets.some((target) => doubtsAbout(target).length > 0),
  isDone: ({ state }) => state.targets.length > 0 && state.targets.every((target) => target.has_colors),
  enter: (app) => mark(app),
  hint: (app) => {
    const target = app.state.targets.find(({ name }) => name === app.target);
    if (!app.camera) return "Add a camera first.";
    if (!target) return "Give the object a name first.";
    if (!target.samples.length) return target.has_colors ? "The colours are known." : isBall(target) ? `Click ${target.name} in the picture, or drag a box around it.` : `Drag a box closely around ${target.name}.`;
    const again = isBall(target) ? "click there, too" : "drag a box there, too";
    const isLive = app.state.cameras.some(({ source }) => source?.is_live);
    const others = isLive ? "Hold pictures with other light or distance, also of other cameras" : "Go to frames with other light or distance";
    return `The white line is the outline that was found. ${others}, and ${again}: three or four are enough.`;
  },
  picture: (app, name) => ({
    help: "Arrows move a cross, Enter points at the object, B begins and ends a box.",
    point: app.target && ((at_px) => label(app, { at_px })),
    box: app.target && ((box_px) => label(app, { box_px })),
    draw: (context, px, about) => {
      const target = app.state.targets.find((one) => one.name === app.target);
      for (const sample of target?.samples ?? []) {
        if (sample.camera === name && sample.frame === about.index) {
          drawOutline(context, px, sample.outline_px);
          const [u, v] = sample.outline_px.reduce((a, b) => (a[1] < b[1] ? a : b));
          drawText(context, px, target.name, [u, v - 10 * px]);
        }
      }
    },
  }),
  pictureKey: (app) => app.target,
  seen: (app, topic) => topic === `image/${app.camera}` && mark(app),
  imageOf: (app, name) => {
    const marked = app.images.get("marked");
    const shown = app.images.get(name);
    const target = app.state.targets.find((one) => one.name === app.target);
    return isMarked && target?.samples.length && marked && shown && marked.about.index === shown.about.index ? marked : null;
  },

  render(app) {
    const { targets } = app.state;
    const name = el("input", { type: "text", id: "new-target", value: targets.length ? "" : "ball", spellcheck: "false" });
    selectAtFirst(name);
    const add = el(
      "form",
      { class: "row", onsubmit: (event) => { event.preventDefault(); addTarget(app, name.value.trim().replace(/\s+/g, "-")); } },
      el("label", { class: "field" }, el("span", {}, targets.length ? "Another object" : "Name of the object"), name),
      el("button", { type: "submit", id: "add-target" }, "Add"),
    );
    const target = targets.find((one) => one.name === app.target);
    if (!target) return [add];
    const samples = target.samples.map(({ camera, frame }, number) =>
      el(
        "li",
        {},
        button(`${camera}, frame ${frame}`, () => { app.select("camera", camera); app.order(camera, { frame, is_playing: false }); }, { class: "entry" }),
        button("Remove", () => app.change("unlabel", { target: target.name, number }), { "aria-label": `Remove the label of frame ${frame}` }),
      ),
    );
    const about = app.images.get("marked")?.about;
    const doubts = doubtsAbout(target);
    const toggle = el("input", {
      type: "checkbox", id: "marked", checked: isMarked, disabled: !samples.length,
      onchange: (event) => { isMarked = event.target.checked; asked = null; mark(app); app.showImages(); app.render(); },
    });
    const relearn = () => app.change("learn_anew", { target: target.name }).then((answer) => answer && app.say("The colours are to be learnt anew. Undo goes back to those before."));
    return [
      !samples.length && target.has_colors && el("p", { class: "row" }, button("Learn them anew", relearn, { id: "learn-anew" })),
      targets.length > 1 && el("label", { class: "field" }, el("span", {}, "Object"), choice(targets.map((one) => [one.name, one.name]), app.target, (name) => app.select("target", name), { id: "target" })),
      samples.length > 0 && [el("h3", {}, `Labels of ${target.name}`), el("ul", { class: "rows", id: "labels" }, samples)],
      doubts.length > 0 && el("p", { class: "bad", id: "doubts" }, doubts.join(" ")),
      target.learnt?.palette && el("p", { class: "now", id: "palette" }, `The colours are divided as with ${target.learnt.palette}: as usual, ${target.name} is not found in every labelled frame.`),
      samples.length > 0 && el("label", { class: "check" }, toggle, "Show everything that has these colours"),
      isMarked && about && el("p", { class: "now", id: "share" }, `${(100 * about.share).toFixed(2)} % of this image. Of the labelled object ${Math.round(100 * about.found)} % is found; of the rest ${(100 * about.mistaken).toFixed(2)} % has its colours, too: ${about.mistaken > MOST_MISTAKEN ? "that is too much." : "that is usual, and the outline tells them apart."}`),
      targets.length > 0 && disclosure("another-target", "Another object", add),
    ];
  },
};
