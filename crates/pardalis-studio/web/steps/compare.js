// Settings that are changed between runs, and the comparison of the last run with an earlier one.

import { button, choice, disclosure, el, field } from "../elements.js";

/** What tells an earlier run from the last: its settings that differ. */
function optionOf({ number, settings }) {
  const values = settings.slice(0, 3).map(({ key, values: [value] }) => `${key.split(".").at(-1)} ${value ?? "not set"}`);
  const text = [...values, ...(settings.length > 3 ? ["…"] : [])].join(", ");
  return [String(number), `run ${number}${text && ": "}${text}`];
}

/** The choice of a run to compare with; `chosen` is its number or null, and `comparison` what came of it. Below it, a page of the comparison is written. */
export function compareControl(app, chosen, comparison, pick) {
  const { earlier } = app.state.run ?? {};
  if (!earlier?.length) return null;
  const options = [["", "no other run"], ...[...earlier].reverse().map(optionOf)];
  const select = choice(options, String(chosen ?? ""), (value) => pick(value ? Number(value) : null), { id: "compare-with" });
  const outlines = comparison?.has_other_cameras ? "It had other cameras, so that its outlines are not drawn into the pictures." : "Its outlines are orange in the pictures of the replay, too.";
  const write = () => app.change("write_comparison", { run: chosen }).then((answer) => answer && app.say(`Written to ${answer.page}: one file, which can be sent.`));
  return [
    field("Compare with", select, chosen && `The other run is orange, and dashed in plots and in 3D. ${outlines}`),
    chosen && el("p", { class: "row" }, button("Write a page of the comparison", write, { id: "write-comparison" })),
  ];
}

/** Sets a number in the scene. A field with one that is refused shows the present one again. */
export function setNumber(app, key, value) {
  return app.change("set_number", { key, value }).then((answer) => answer || app.render());
}

/** Fields for settings that people vary. */
export function settingsControl(app) {
  const whole = (key, id, value, min) => {
    const set = () => {
      const number = Number(input.value);
      if (input.value.trim() === "" || !Number.isInteger(number)) app.say("Type a whole number.", true), app.render();
      else setNumber(app, key, number);
    };
    const input = el("input", { type: "number", id, min, step: 1, value, onchange: set });
    return input;
  };
  const targets = app.state.targets.filter(({ shape }) => shape).map(({ name, shape, particles }) => {
    const radius_m = shape.sphere?.radius_m;
    const setSize = () => app.change("set_shape", { target: name, kind: "sphere", sizes: { radius_m: Number((Number(size.value) / 200).toPrecision(9)) } }).then((answer) => answer || app.render());
    const size = Number.isFinite(radius_m) && el("input", { type: "number", id: `run-diameter-${name}`, min: 0, step: "any", value: Number((200 * radius_m).toPrecision(6)), onchange: setSize });
    return el("div", { class: "row" }, field(`${name}: particles`, whole(`targets.${name}.filter.particles`, `particles-${name}`, particles, 1)), size && field("Diameter in cm", size));
  });
  const seed = field("Seed", whole("seed", "seed", app.state.seed, 0), "Another seed draws other random numbers: it shows how much of a result is chance.");
  const particles = el("p", { class: "none" }, "Particles are the hypotheses of where a target is: more take longer, and follow abrupt motion better.");
  return disclosure("settings", "Change a setting", [seed, targets, targets.length > 0 && particles]);
}
