// The recording of live cameras, which can be tracked again.

import { button, el } from "../elements.js";

/** Whether the images of the next run are kept. */
let isOn = false;

export const hasLive = (app) => app.state.cameras.some(({ source }) => source?.is_live);

/** Whether the next run is recorded. */
export const records = (app) => isOn && hasLive(app);

/** The choice before a run. */
export function recordControl(app) {
  if (!hasLive(app)) return null;
  const box = el("input", { type: "checkbox", id: "record", checked: isOn, onchange: () => (isOn = box.checked) });
  return el("label", { class: "check" }, box, "Record the images");
}

/** How much has been recorded, from the state of the run or its latest message. */
export function recordedText({ images, bytes, dropped, is_full: isFull, error }) {
  const lost = dropped > 0 ? `, ${dropped} left out because they came too fast` : "";
  const end = isFull ? "; that is the most that is kept" : "";
  const text = el("p", { class: "now", id: "recorded" }, `Recorded ${images} images, ${(bytes / 1e6).toFixed(1)} MB${lost}${end}.`);
  return error ? [text, el("p", { class: "bad" }, error)] : [text];
}

/** What can be done with the recording of the last run. */
export function recordingControl(app) {
  const { recording } = app.state.run;
  if (!recording?.images) return recording?.error ? el("p", { class: "bad" }, recording.error) : null;
  const isUsed = !hasLive(app);
  const use = () => app.change("use_recording").then((answer) => answer && app.say("The scene has the recording in place of the cameras. Undo goes back to the cameras."));
  return [recordedText(recording), el("p", {}, el("small", {}, `In the folder ${recording.folder}.`)), !isUsed && el("p", {}, button("Use the recording", use, { id: "use-recording" }), el("small", {}, " It takes the place of the cameras in the scene; undo puts them back."))];
}
