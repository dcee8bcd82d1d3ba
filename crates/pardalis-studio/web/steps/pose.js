// Step 3: where each camera is.

import { el, fixed } from "../elements.js";

export const pose = {
  id: "pose",
  title: "Pose",
  isBegun: ({ state }) => state.cameras.length > 0,
  isDone: ({ state }) => state.cameras.length > 0 && !state.guesses.some(({ step }) => step === "pose"),
  hint: (app) => (app.camera ? `Where is ${app.camera}, and where does it look?` : "Add a camera first."),

  render(app) {
    const one = app.state.cameras.find(({ name }) => name === app.camera);
    if (!one) return [];
    const isGuess = app.state.guesses.some(({ key }) => key === `cameras.${one.name}.world_from_camera`);
    const at = one.position_m && one.position_m.map((value) => fixed(value, 2)).join(", ");
    return [
      el("p", { class: "now" }, isGuess ? "Unknown: positions will be relative to a guess." : `At ${at} m.`),
      isGuess && el("p", {}, "With one camera you can go on: distances and movements as seen by the camera are right, and only their directions in the room are not."),
    ];
  },
};
