// The bar below the pictures of a finished run: moves through its recordings, whose frames have the outlines of the run.

import { button, el } from "../elements.js";

/** The camera with the most frames tells where the replay is. */
function longest(app) {
  const counted = app.state.cameras.filter(({ source }) => source?.frame_count > 1);
  return counted.sort((a, b) => b.source.frame_count - a.source.frame_count)[0] ?? null;
}

/** Whether the last run can be replayed: its frames come from recordings. */
export function canReplay(app) {
  const { run, cameras } = app.state;
  return Boolean(run && !run.goes_on && run.can_replay && longest(app) && cameras.every(({ source }) => source && !source.is_live));
}

/** Shows the frames of all cameras at the same share of their recordings. */
function goTo(app, frame, more = {}) {
  const last = longest(app).source.frame_count - 1;
  const share = Math.min(Math.max(frame / last, 0), 1);
  for (const { name, source } of app.state.cameras) app.order(name, { frame: Math.round(share * (source.frame_count - 1)), is_playing: false, ...more });
}

/** Plays from the frame that the bar shows, or from the first at its end. */
function play(app, from) {
  goTo(app, from + 1 >= longest(app).source.frame_count ? 0 : from, { is_playing: true });
}

function pause(app) {
  for (const { name } of app.state.cameras) app.order(name, { is_playing: false });
}

function now(app) {
  const source = app.latest.get(`source/${longest(app).name}`);
  return { frame: source?.frame ?? 0, isPlaying: Boolean(source?.is_playing) };
}

/** The frame that is shown, with the targets then; null if there is none yet. */
export function replayedNow(app) {
  return app.images.get(longest(app).name)?.about ?? null;
}

/** `begin` is called when the user moves; before that, the bar stands at the end of the run. */
export function replayBar(app, isReplay, begin) {
  const count = longest(app).source.frame_count;
  const at = isReplay ? now(app).frame : count - 1;
  const slider = el("input", {
    type: "range", id: "replay-frame", min: 0, max: count - 1, value: at, "aria-label": "Frame of the run",
    oninput: () => { begin(); goTo(app, Number(slider.value)); },
  });
  const toggle = button("▶ Replay", () => {
    begin();
    if (toggle.dataset.plays === "yes") pause(app);
    else play(app, Number(slider.value));
  }, { id: "replay-play" });
  return el("div", { id: "replay" }, toggle, slider, el("span", { class: "number-of-frame" }, `${at} / ${count - 1}`));
}

/** Follows the frame that is shown. */
export function updateReplay(app) {
  const bar = document.getElementById("replay");
  if (!bar) return;
  const { frame, isPlaying } = now(app);
  const [toggle, slider, number] = bar.children;
  toggle.dataset.plays = isPlaying ? "yes" : "no";
  toggle.textContent = isPlaying ? "❚❚ Pause" : "▶ Replay";
  if (document.activeElement !== slider || isPlaying) slider.value = frame;
  number.textContent = `${frame} / ${longest(app).source.frame_count - 1}`;
}
