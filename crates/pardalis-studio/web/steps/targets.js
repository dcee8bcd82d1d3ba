// Step 5: the shape of each target, and how large it is.

import { button, choice, el, field } from "../elements.js";

const UNITS = { mm: 0.001, cm: 0.01, m: 1, in: 0.0254 };
const GUESS_M = 0.2;

/** Sizes of shapes: their names, the keys of the scene, the places in these if they are lists, and how many times the value of the key they are. */
const HEIGHT = { id: "height", name: "Height", key: "height_m" };
const ABOVE = { ...HEIGHT, name: "Height above the floor", guess_m: 0 };
const DIAMETER = { id: "diameter", name: "Diameter", key: "radius_m", times: 2 };
const SIDES = [["length", "Length, as it faces"], ["width", "Width"], ["height", "Height"]].map(([id, name], place) => ({ id, name, key: "size_m", place }));
const SHAPES = {
  sphere: { title: "Ball", sizes: [DIAMETER] },
  cylinder: { title: "Cylinder that stands", sizes: [DIAMETER, HEIGHT] },
  box: { title: "Box", sizes: SIDES },
  prism: { title: "Prism that stands", sizes: [{ id: "width", name: "Width, from side to side", key: "across_flats_m" }, HEIGHT] },
  disc: { title: "Disc that lies flat", sizes: [DIAMETER, ABOVE] },
  rectangle: { title: "Rectangle that lies flat", sizes: [...SIDES.slice(0, 2), ABOVE] },
};

/** The unit and the kind of shape that are chosen for each target. */
const unitOf = new Map();
const kindOf = new Map();

/** Returns a size in metres as the scene has it; a guess if it has none. */
function sizeOf(shape, { key, place, times = 1, guess_m: guess = GUESS_M }) {
  const value = place === undefined ? shape?.[key] : shape?.[key]?.[place];
  return Number.isFinite(value) ? times * value : guess;
}

/** Without the digits that conversions add. */
const rounded = (value) => Number(value.toPrecision(9));

function form(app, target) {
  const { name } = target;
  const now = Object.keys(target.shape)[0];
  const kind = kindOf.get(name) ?? now;
  const shape = SHAPES[kind];
  const unit = unitOf.get(name) ?? "cm";
  const inputs = shape.sizes.map((size) => {
    const value = Number((sizeOf(target.shape[kind], size) / UNITS[unit]).toPrecision(6));
    // Other shapes are set as a whole.
    return el("input", { type: "number", id: `${size.id}-${name}`, min: 0, step: "any", value, onchange: kind === now && ((event) => set(event)) });
  });
  const pick = (map) => (one) => { map.set(name, one); app.render(); };
  const kinds = choice(Object.entries(SHAPES).map(([key, { title }]) => [key, title]), kind, pick(kindOf), { id: `kind-${name}` });
  const units = choice(Object.keys(UNITS).map((one) => [one, one]), unit, pick(unitOf), { id: `unit-${name}`, "aria-label": "Unit" });
  const set = (event) => {
    event.preventDefault();
    const sizes = {};
    shape.sizes.forEach(({ key, place, times = 1 }, i) => {
      const value = rounded((Number(inputs[i].value) * UNITS[unit]) / times);
      if (place === undefined) sizes[key] = value;
      else (sizes[key] ??= [])[place] = value;
    });
    app.change("set_shape", { target: name, kind, sizes }).then((answer) => (answer ? kindOf.delete(name) : app.render()));
  };
  const last = inputs.length - 1;
  const isGuess = app.state.guesses.some(({ key }) => key.startsWith(`targets.${name}.`));
  const isUnknown = target.shape.sphere?.radius_m === "unknown";
  return [
    field("Shape", kinds),
    el("form", { onsubmit: set }, inputs.slice(0, last).map((input, i) => field(shape.sizes[i].name, input)), el("p", { class: "row" }, field(shape.sizes[last].name, inputs[last]), units, el("button", { type: "submit", id: `set-${name}` }, "Set"))),
    kind !== now && el("p", { class: "now" }, `${SHAPES[now]?.title ?? now} until you set it.`),
    isGuess && kind === now && el("p", { class: "now" }, "This is a guess. Measure it: distances are wrong by as many per cent as its size."),
    isUnknown && kind === now && el("p", { class: "now" }, "Its size is unknown: the cameras measure it."),
    kind === "sphere" && !isUnknown && app.state.cameras.length > 1 && button("Unknown: let the cameras measure it", () => app.change("set_shape", { target: name, kind, sizes: { radius_m: "unknown" } }), { id: `unknown-${name}` }),
    measured(app, target, unit),
  ];
}

/** Returns what the cameras said of the size in the last run. */
function measured(app, { name }, unit) {
  const radius = app.state.run?.radii?.find(({ key }) => key === `targets.${name}`);
  if (!radius) return null;
  const shown = (radius_m, digits) => Number(((2 * radius_m) / UNITS[unit]).toPrecision(digits));
  const text = `In the last run the cameras measured ${shown(radius.radius_m, 4)} ± ${shown(radius.sigma_m, 2)} ${unit}.`;
  const use = () => app.change("set_shape", { target: name, kind: "sphere", sizes: { radius_m: rounded(Number(radius.radius_m.toPrecision(4))) } });
  return [
    el("p", { class: radius.is_contradicted ? "bad" : "now", id: `measured-${name}` }, text, radius.is_contradicted && " That contradicts the scene, unless the calibrations of the cameras are wrong."),
    radius.is_contradicted && button("Use what they measured", use, { id: `use-${name}` }),
  ];
}

export const targets = {
  id: "targets",
  title: "Targets",
  isBegun: ({ state }) => state.targets.length > 0,
  isDone: ({ state }) => state.targets.length > 0 && !state.guesses.some(({ step }) => step === "targets"),
  hint: ({ state }) => (state.targets.length ? "What shape does it have, and how large is it? The distance is computed from the size." : "Name an object in the step Colours first."),

  render(app) {
    return app.state.targets.map((target) => [
      el("h3", {}, target.name),
      target.shape ? form(app, target) : el("p", {}, "Its parts are described in the scene file."),
      el("p", {}, button(`Remove ${target.name}`, () => app.change("remove", { kind: "targets", name: target.name }))),
    ]);
  },
};
