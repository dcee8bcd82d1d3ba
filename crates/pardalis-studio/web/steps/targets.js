// Step 5: how large each target is.

import { button, choice, el, field } from "../elements.js";

const UNITS = { mm: 0.001, cm: 0.01, m: 1, in: 0.0254 };
const unitOf = new Map();

function ball(app, target) {
  const { name, radius_m: radius } = target;
  const unit = unitOf.get(name) ?? "cm";
  const diameter = Number((2 * radius / UNITS[unit]).toPrecision(6));
  const input = el("input", { type: "number", id: `diameter-${name}`, min: 0, step: "any", value: diameter });
  const units = choice(Object.keys(UNITS).map((one) => [one, one]), unit, (one) => { unitOf.set(name, one); app.render(); }, { id: `unit-${name}`, "aria-label": "Unit" });
  const set = (event) => {
    event.preventDefault();
    // Without the digits that the conversion adds.
    const radius_m = Number((0.5 * Number(input.value) * UNITS[unit]).toPrecision(9));
    app.change("set_radius", { target: name, radius_m });
  };
  const isGuess = app.state.guesses.some(({ key }) => key.startsWith(`targets.${name}.`));
  return [
    el("form", { class: "row", onsubmit: set }, field("Diameter", input), units, el("button", { type: "submit", id: `set-${name}` }, "Set")),
    isGuess && el("p", { class: "now" }, "This is a guess. Measure the ball: distances are wrong by as many per cent as its size."),
    app.state.cameras.length > 1 && button("Unknown: let the cameras measure it", () => app.change("set_radius", { target: name, radius_m: null })),
  ];
}

export const targets = {
  id: "targets",
  title: "Targets",
  isBegun: ({ state }) => state.targets.length > 0,
  isDone: ({ state }) => state.targets.length > 0 && !state.guesses.some(({ step }) => step === "targets"),
  hint: ({ state }) => (state.targets.length ? "How large is it? The distance is computed from the size." : "Name an object in the step Colours first."),

  render(app) {
    return app.state.targets.map((target) => [
      el("h3", {}, target.name),
      target.shape === "sphere" ? ball(app, target) : el("p", {}, "Its shape is described in the scene file."),
      el("p", {}, button(`Remove ${target.name}`, () => app.change("remove", { kind: "targets", name: target.name }))),
    ]);
  },
};
